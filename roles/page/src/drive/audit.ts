/**
 * What a moving eye does not see yet. A picture is drawn from the newest pose, out of the set that was found
 * for an earlier one. Afterwards an audit goes back to that pose, and holds the picture against the exact
 * one.
 */

import type { Drawable } from "../draw/model.ts";
import type { Point } from "../navigate/gaze.ts";
import type { Camera } from "../proto/camera.ts";
import type { WrongPixels } from "../service/service.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { wrongShare } from "../viewer/wrongPixels.ts";
import { Samples } from "./samples.ts";
import { until } from "./time.ts";

/** Of longer walks only so many pictures are audited, or half as many, evenly over the walk. */
const MOST = 500;
/** A picture is as good as right where it shows another object at this percentage of pixels at most. */
const FEW = 0.1;

/** A picture of a walk. */
export interface Taken {
  /** Milliseconds since the page began. */
  readonly at: number;
  readonly camera: Camera;
  readonly forward: Point;
  /** Nothing where it is not audited. */
  readonly drawables: readonly Drawable[] | undefined;
  /** The eye has jumped, and since then no set has come that is all there. */
  readonly hasJumped: boolean;
}

/** The pictures of a walk. However long it is, drawables are kept of a bounded number of them. */
export class Album {
  readonly #pictures: Taken[] = [];
  #stride = 1;

  get pictures(): readonly Taken[] {
    return this.#pictures;
  }

  add(picture: Taken): void {
    const at = this.#pictures.length;
    this.#pictures.push(at % this.#stride === 0 ? picture : { ...picture, drawables: undefined });
    if (this.#pictures.length > MOST * this.#stride) {
      this.#stride *= 2;
      for (const [number, kept] of this.#pictures.entries()) {
        if (number % this.#stride !== 0 && kept.drawables !== undefined) {
          this.#pictures[number] = { ...kept, drawables: undefined };
        }
      }
    }
  }
}

/** Goes to where pictures were taken, over no network, and counts the pixels that were wrong. */
export async function audit(viewer: Viewer, pictures: readonly Taken[]): Promise<WrongPixels> {
  viewer.session.moveTo("");
  const percent = new Samples();
  const [wrong, jumping] = [new Spans(), new Spans()];
  for (const { at, camera, forward, drawables, hasJumped } of pictures) {
    jumping.add(at, hasJumped);
    if (hasJumped || drawables === undefined) {
      continue;
    }
    viewer.navigator.goTo([...camera.eye], [...forward]);
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

/** How long something held without a break. */
export class Spans {
  longest = 0;
  #since: number | undefined;

  /** At this time it holds or not. Until the next time that stays so. */
  add(at: number, holds: boolean): void {
    if (this.#since !== undefined) {
      this.longest = Math.max(this.longest, at - this.#since);
    }
    this.#since = holds ? (this.#since ?? at) : undefined;
  }
}
