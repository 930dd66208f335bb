/**
 * Measures the errors of a moving eye's pictures. Each is drawn from the newest pose, with the set that was
 * found for an earlier one. Afterwards an audit returns to that pose, and compares with the exact picture.
 */

import type { Drawable } from "../draw/model.ts";
import type { Camera } from "../proto/camera.ts";
import type { Point } from "../space/point.ts";
import { Samples } from "../viewer/samples.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { wrongShare } from "../viewer/wrongPixels.ts";
import { until } from "./time.ts";

/** Of longer walks at most this many pictures are audited, and at least half as many. */
const MOST = 500;
/** A picture counts as right if at most this percentage of pixels shows another object. */
const FEW = 0.1;

/** A picture of a walk. */
export interface Taken {
  /** Milliseconds since the page began. */
  readonly at: number;
  readonly camera: Camera;
  readonly forward: Point;
  /** Nothing if it is not audited. */
  readonly drawables: readonly Drawable[] | undefined;
  /** The eye has jumped, and no complete set has come since. */
  readonly hasJumped: boolean;
}

/** The pictures of a walk. However long it is, the drawables of only a bounded number are kept. */
export class Album {
  readonly pictures: Taken[] = [];
  #stride = 1;

  add(picture: Taken): void {
    const at = this.pictures.length;
    this.pictures.push(at % this.#stride === 0 ? picture : { ...picture, drawables: undefined });
    if (this.pictures.length > MOST * this.#stride) {
      this.#stride *= 2;
      for (const [number, kept] of this.pictures.entries()) {
        if (number % this.#stride !== 0 && kept.drawables !== undefined) {
          this.pictures[number] = { ...kept, drawables: undefined };
        }
      }
    }
  }
}

/**
 * Returns to the poses of pictures, without a simulated network, and counts the wrong pixels: see
 * `WrongPixels` of `src/page/drive.rs`.
 */
export async function audit(viewer: Viewer, pictures: readonly Taken[]) {
  viewer.session.moveTo("");
  const percent = new Samples();
  const [wrong, jumping] = [new Spans(), new Spans()];
  for (const { at, camera, forward, drawables, hasJumped } of pictures) {
    jumping.add(at, hasJumped);
    if (hasJumped || drawables === undefined) {
      continue;
    }
    viewer.navigator.goTo(camera.eye, forward);
    await until(() => viewer.isSettled);
    const exact = viewer.shown();
    const items = (of: readonly Drawable[]) => viewer.renderer.items(camera, of, viewer.look());
    const share = 100 * wrongShare(items(drawables), items(exact), [...drawables, ...exact]);
    percent.add(share);
    wrong.add(at, share > FEW);
  }
  return {
    pictures: percent.count,
    right: percent.countOf((share) => share === 0),
    medianPercent: percent.share(0.5),
    p95Percent: percent.share(0.95),
    meanPercent: percent.mean,
    mostPercent: percent.share(1),
    longestMs: wrong.longest,
    jumpMs: jumping.longest,
  };
}

/** How long a condition held without a break. */
export class Spans {
  longest = 0;
  #since: number | undefined;

  /** The condition holds or not from this time until the next call. */
  add(at: number, holds: boolean): void {
    if (this.#since !== undefined) {
      this.longest = Math.max(this.longest, at - this.#since);
    }
    this.#since = holds ? (this.#since ?? at) : undefined;
  }
}
