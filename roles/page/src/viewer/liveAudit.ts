/**
 * Compares a picture of a moving eye with the exact one now and then. The pose of the picture is culled for
 * as well, and both are compared once that set has arrived.
 */

import { signal } from "@preact/signals";
import { NOTHING } from "../draw/device.ts";
import type { Drawable } from "../draw/model.ts";
import type { Camera } from "../proto/camera.ts";
import type { Viewer } from "./viewer.ts";
import { wrongShare } from "./wrongPixels.ts";

/** Milliseconds between two audited pictures. */
const PERIOD = 1000;
/** The timeout for a set, milliseconds: a newer pose may have been culled in its place. */
const LONGEST = 1500;

/** The result for a picture. */
export interface Audited {
  /** Pixels that show another object than the exact picture, percent. */
  readonly wrongPercent: number;
  /** Drawables of the picture, and those of the exact one. */
  readonly drawn: number;
  readonly visible: number;
}

interface Sample {
  readonly at: number;
  readonly camera: Camera;
  readonly drawables: readonly Drawable[];
  /** The frame with the exact set for it. */
  readonly frame: number;
}

export class LiveAudit {
  readonly #viewer: Viewer;
  #sample: Sample | undefined;
  #last = Number.NEGATIVE_INFINITY;
  /** The result of the last audit. */
  readonly found = signal<Audited | undefined>(undefined);

  constructor(viewer: Viewer) {
    this.#viewer = viewer;
  }

  /** Audits pictures until the returned function is called. */
  start(): () => void {
    return this.#viewer.onPicture((camera, drawables) => this.#picture(camera, drawables));
  }

  #picture(camera: Camera, drawables: readonly Drawable[]): void {
    const now = performance.now();
    const sample = this.#sample;
    if (sample === undefined) {
      if (now - this.#last >= PERIOD) {
        const frame = this.#viewer.ask(camera);
        this.#sample = frame === undefined ? undefined : { at: now, camera, drawables, frame };
      }
      return;
    }
    const shown = this.#viewer.display?.shown;
    const isOwn = shown?.led === undefined;
    if (isOwn && shown?.camera.frame === sample.frame && shown.isExact) {
      this.found.value = this.#audit(sample, shown.found);
      [this.#sample, this.#last] = [undefined, now];
    } else if (now - sample.at > LONGEST) {
      this.#sample = undefined;
    }
  }

  #audit({ camera, drawables }: Sample, found: readonly Drawable[]): Audited {
    const { renderer } = this.#viewer;
    const look = this.#viewer.look();
    const shown = renderer.items(camera, drawables, look);
    const exact = renderer.items(camera, found, look);
    const visible = new Set(exact);
    visible.delete(NOTHING);
    return {
      wrongPercent: 100 * wrongShare(shown, exact, [...drawables, ...found]),
      drawn: drawables.length,
      visible: visible.size,
    };
  }
}
