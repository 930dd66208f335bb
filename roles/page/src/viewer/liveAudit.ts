/**
 * Now and then holds a picture of a moving eye against the exact one. The pose of the picture is culled for
 * as well, and both are compared when that set is there.
 */

import { signal } from "@preact/signals";
import { NOTHING } from "../draw/device.ts";
import type { Drawable } from "../draw/model.ts";
import type { Camera } from "../proto/camera.ts";
import type { Viewer } from "./viewer.ts";
import { wrongShare } from "./wrongPixels.ts";

/** Milliseconds between two pictures that are audited. */
const PERIOD = 1000;
/** Milliseconds after which no set is waited for: a newer pose may have been culled in its place. */
const LONGEST = 1500;

/** What was found of a picture. */
export interface Audited {
  /** Pixels that show another object than the exact picture, percent. */
  readonly wrongPercent: number;
  /** Drawables that were drawn, and those that the exact picture shows. */
  readonly drawn: number;
  readonly visible: number;
}

interface Sample {
  readonly at: number;
  readonly camera: Camera;
  readonly drawables: readonly Drawable[];
  /** The frame of which the set is exact for it. */
  readonly frame: number;
}

export class LiveAudit {
  readonly #viewer: Viewer;
  #sample: Sample | undefined;
  #last = Number.NEGATIVE_INFINITY;
  /** Of the last picture that was audited. */
  readonly found = signal<Audited | undefined>(undefined);

  constructor(viewer: Viewer) {
    this.#viewer = viewer;
  }

  /** Audits pictures until the function that this gives is called. */
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
    if (shown?.camera.frame === sample.frame && shown.isExact) {
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
