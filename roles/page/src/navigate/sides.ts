/** From which side something is looked at. */

import type { Point } from "./gaze.ts";
import { dot } from "./orbit.ts";

/** A side of a part of the model. */
export interface Side {
  /** From the part to an eye there, a unit vector of the world. */
  readonly from: Readonly<Point>;
  /** The share of the part that something else hides from there, as far as boxes tell. */
  readonly hidden: number;
}

/** The gaze of an eye at the side that shows most of a part, and least far round from a gaze `now`. */
export function mostOpen(sides: readonly Side[], now: Readonly<Point>): Point | undefined {
  const length = Math.hypot(...now) || 1;
  const costOf = ({ from, hidden }: Side) => 2 * hidden + (1 + dot(from, now) / length) / 2;
  const [best] = [...sides].sort((a, b) => costOf(a) - costOf(b));
  return best && [-best.from[0], -best.from[1], -best.from[2]];
}
