/** Places an eye so that a box fills its picture. */

import { type Box, centreOf, cornersOf, sizeOf } from "../space/box.ts";
import { type Point, pointOf } from "../space/point.ts";
import type { Gaze } from "./gaze.ts";
import { along, axesOf, stepsOf } from "./orbit.ts";

/** The filled share of the picture's width or height. */
const FILLED = 0.86;
/** The least distance to the nearest corner, in sides of the box; for a point, in metres. */
const NEAREST = 0.01;
const SMALLEST = 1e-3;

/**
 * The eye with this gaze to which a box fills as much of the picture as possible. Half of the picture's width
 * and height at distance one are `tanX` and `tanY`.
 */
export function framingEye(box: Box, gaze: Gaze, tanX: number, tanY: number): Point {
  const axes = axesOf(gaze);
  const size = sizeOf(box);
  const half = pointOf((axis) => size[axis] / 2);
  const around = { min: pointOf((axis) => -half[axis]), max: half };
  const corners = cornersOf(around).map((corner) => stepsOf(corner, axes));
  // A corner at (s, f) is in the picture of an eye at (a, -d) where |s - a| <= t (f + d).
  const across = ([tanX, tanY] as const).map((tan, axis) => {
    const t = FILLED * tan;
    const most = Math.max(...corners.map((corner) => (corner[axis] ?? 0) - t * corner[2]));
    const least = Math.min(...corners.map((corner) => (corner[axis] ?? 0) + t * corner[2]));
    return { way: (most + least) / 2, back: (most - least) / (2 * t) };
  });
  const front = Math.max(...corners.map((corner) => -corner[2]));
  const reach = Math.max(Math.hypot(...half), SMALLEST);
  const back = Math.max(front + NEAREST * reach, SMALLEST, ...across.map(({ back }) => back));
  return along(centreOf(box), axes, [across[0]?.way ?? 0, across[1]?.way ?? 0, -back]);
}
