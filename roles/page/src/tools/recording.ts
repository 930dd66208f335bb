/** Records a walk: a camera path for `trimaran run --path`. */

import { signal } from "@preact/signals";
import { isParallel } from "../navigate/parallel.ts";
import type { Point } from "../space/point.ts";
import type { Viewer } from "../viewer/viewer.ts";

/** Poses a second. */
const RATE = 30;
/** The longest walk: ten minutes. */
const MOST = 600 * RATE;

export interface RecordedPose {
  readonly eye: Point;
  readonly forward: Point;
}

export class Recording {
  readonly isOn = signal(false);
  readonly #viewer: Viewer;
  #poses: RecordedPose[] = [];
  /** The last field of view, degrees. A path has one for all its poses. */
  #vfovDeg = 0;
  #timer: ReturnType<typeof setInterval> | undefined;

  constructor(viewer: Viewer) {
    this.#viewer = viewer;
  }

  start(): void {
    const { navigator } = this.#viewer;
    this.#poses = [];
    this.#vfovDeg = navigator.vfovDeg;
    this.isOn.value = true;
    this.#timer = setInterval(() => {
      const { eye, forward, vfovDeg } = navigator;
      // An eye of the other projection is at another distance: it is left out.
      if (isParallel(vfovDeg) !== isParallel(this.#vfovDeg)) {
        return;
      }
      this.#vfovDeg = vfovDeg;
      this.#poses.push({ eye, forward });
      if (this.#poses.length === MOST) {
        clearInterval(this.#timer);
      }
    }, 1000 / RATE);
  }

  /** Ends it, and returns the path as JSON. */
  stop(): string {
    clearInterval(this.#timer);
    this.isOn.value = false;
    return pathJson(this.#vfovDeg, this.#poses);
  }
}

/** A camera path in the format of a file: up is y everywhere. */
export function pathJson(vfovDeg: number, poses: readonly RecordedPose[]): string {
  const frames = poses.map(({ eye, forward }) => ({ eye, forward, up: [0, 1, 0] }));
  return JSON.stringify({ vfov_deg: vfovDeg, frames }).replaceAll("},{", "},\n{");
}
