/** Places an eye so that what it looks at fills its picture. */

import { around, centreOf, sizeOf } from "../space/box.ts";
import { minus, type Point } from "../space/point.ts";
import type { Gaze } from "./gaze.ts";
import { along, axesOf, stepsOf } from "./orbit.ts";

/** The filled share of the picture's width or height. */
const FILLED = 0.86;
/** The least distance to the nearest point, in sizes of all of them; for one alone, in metres. */
const NEAREST = 0.01;
const SMALLEST = 1e-3;
const ORIGIN: Point = [0, 0, 0];

/**
 * The eye with this gaze to which points fill as much of the picture as possible. Half of the picture's width
 * and height at distance one are `tanX` and `tanY`.
 */
export function framingEye(points: readonly Point[], gaze: Gaze, tanX: number, tanY: number): Point {
  const axes = axesOf(gaze);
  const box = around(points.map((point) => ({ min: point, max: point })));
  const [centre, size] = box === undefined ? [ORIGIN, ORIGIN] : [centreOf(box), sizeOf(box)];
  // About their middle, so that far coordinates cost no digits.
  const corners = points.map((point) => stepsOf(minus(point, centre), axes));
  // A point at (s, f) is in the picture of an eye at (a, -d) where |s - a| <= t (f + d).
  const across = ([tanX, tanY] as const).map((tan, axis) => {
    const t = FILLED * tan;
    const most = Math.max(...corners.map((corner) => (corner[axis] ?? 0) - t * corner[2]));
    const least = Math.min(...corners.map((corner) => (corner[axis] ?? 0) + t * corner[2]));
    return { way: (most + least) / 2, back: (most - least) / (2 * t) };
  });
  const front = Math.max(...corners.map((corner) => -corner[2]));
  const reach = Math.max(Math.hypot(...size) / 2, SMALLEST);
  const back = Math.max(front + NEAREST * reach, SMALLEST, ...across.map(({ back }) => back));
  return along(centre, axes, [across[0]?.way ?? 0, across[1]?.way ?? 0, -back]);
}
