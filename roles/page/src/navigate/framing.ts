/** Places an eye so that a box fills its picture. */

import type { Gaze, Point } from "./gaze.ts";
import { along, axesOf, dot } from "./orbit.ts";

/** Corners of a box with its sides along the axes, metres. */
export interface Box {
  readonly min: Readonly<Point>;
  readonly max: Readonly<Point>;
}

/** The filled share of the picture's width or height. */
const FILLED = 0.86;
/** The least distance to the nearest corner, in sides of the box; for a point, in metres. */
const NEAREST = 0.01;
const SMALLEST = 1e-3;

/** The middle of a box. */
export function centreOf({ min, max }: Box): Point {
  return [(min[0] + max[0]) / 2, (min[1] + max[1]) / 2, (min[2] + max[2]) / 2];
}

/**
 * The eye with this gaze to which a box fills as much of the picture as possible. Half of the picture's width
 * and height at distance one are `tanX` and `tanY`.
 */
export function framingEye(box: Box, gaze: Gaze, tanX: number, tanY: number): Point {
  const { min, max } = box;
  const centre = centreOf(box);
  const axes = axesOf(gaze);
  const half: Point = [(max[0] - min[0]) / 2, (max[1] - min[1]) / 2, (max[2] - min[2]) / 2];
  const corners = [0, 1, 2, 3, 4, 5, 6, 7].map((corner): Point => {
    const side = (axis: 0 | 1 | 2) => (((corner >> axis) & 1) === 1 ? half[axis] : -half[axis]);
    const place: Point = [side(0), side(1), side(2)];
    return [dot(place, axes[0]), dot(place, axes[1]), dot(place, axes[2])];
  });
  // A corner at (s, f) is in the picture of an eye at (a, -d) where |s - a| <= t (f + d).
  const across = ([tanX, tanY] as const).map((tan, axis) => {
    const t = FILLED * tan;
    const most = Math.max(...corners.map((corner) => (corner[axis] ?? 0) - t * corner[2]));
    const least = Math.min(...corners.map((corner) => (corner[axis] ?? 0) + t * corner[2]));
    return { way: (most + least) / 2, back: (most - least) / (2 * t) };
  });
  const front = Math.max(...corners.map((corner) => -corner[2]));
  const size = Math.max(Math.hypot(...half), SMALLEST);
  const back = Math.max(front + NEAREST * size, SMALLEST, ...across.map(({ back }) => back));
  return along(centre, axes, [across[0]?.way ?? 0, across[1]?.way ?? 0, -back]);
}
