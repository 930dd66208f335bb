/** Selects the side from which to look at a part. */

import type { Side } from "../service/service.ts";
import { dot, type Point, pointOf } from "../space/point.ts";

/** The gaze at the most open side of a part, the one nearest to the gaze `now` if several are equal. */
export function mostOpen(sides: readonly Side[], now: Point): Point | undefined {
  const length = Math.hypot(...now) || 1;
  const costOf = ({ from, hidden }: Side) => 2 * hidden + (1 + dot(from, now) / length) / 2;
  const [best] = [...sides].sort((a, b) => costOf(a) - costOf(b));
  return best && pointOf((axis) => -best.from[axis]);
}
