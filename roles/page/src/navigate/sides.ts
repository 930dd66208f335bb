/** Selects the side from which to look at a part. */

import type { Point } from "./gaze.ts";
import { dot } from "./orbit.ts";

/** A side of a part of the model. */
export interface Side {
  /** The direction from the part to an eye there, a unit vector of the world. */
  readonly from: Readonly<Point>;
  /** The share of the part hidden from there, estimated by boxes. */
  readonly hidden: number;
}

/** The gaze at the most open side of a part, the one nearest to the gaze `now` if several are equal. */
export function mostOpen(sides: readonly Side[], now: Readonly<Point>): Point | undefined {
  const length = Math.hypot(...now) || 1;
  const costOf = ({ from, hidden }: Side) => 2 * hidden + (1 + dot(from, now) / length) / 2;
  const [best] = [...sides].sort((a, b) => costOf(a) - costOf(b));
  return best && [-best.from[0], -best.from[1], -best.from[2]];
}
