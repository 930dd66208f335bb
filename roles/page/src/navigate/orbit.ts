/** Orbits a point, as if the model were turned in the hand. */

import type { Gaze, Point } from "./gaze.ts";

/** The right, up and forward directions of a gaze: unit vectors of the world. */
export function axesOf(gaze: Gaze): readonly [Point, Point, Point] {
  const forward = gaze.forward;
  const right: Point = [Math.cos(gaze.heading), 0, -Math.sin(gaze.heading)];
  const up: Point = [
    right[1] * forward[2] - right[2] * forward[1],
    right[2] * forward[0] - right[0] * forward[2],
    right[0] * forward[1] - right[1] * forward[0],
  ];
  return [right, up, forward];
}

export function dot(a: Readonly<Point>, b: Readonly<Point>): number {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/** The place behind `steps` along right, up and ahead. */
export function along(from: Readonly<Point>, axes: readonly Point[], steps: Readonly<Point>): Point {
  const at = (axis: 0 | 1 | 2) =>
    from[axis] + axes.reduce((sum, unit, index) => sum + unit[axis] * (steps[index] ?? 0), 0);
  return [at(0), at(1), at(2)];
}

/** Turns the gaze, and returns the new eye for which the pivot stays at the same place of the picture. */
export function turnAbout(
  pivot: Readonly<Point>,
  eye: Readonly<Point>,
  gaze: Gaze,
  left: number,
  up: number,
): Point {
  const toPivot: Point = [pivot[0] - eye[0], pivot[1] - eye[1], pivot[2] - eye[2]];
  const steps = axesOf(gaze).map((axis) => -dot(toPivot, axis));
  gaze.turn(left, up);
  return along(pivot, axesOf(gaze), [steps[0] ?? 0, steps[1] ?? 0, steps[2] ?? 0]);
}

/** Moves the eye this many metres to the right and upwards, across the viewing direction. */
export function pan(eye: Readonly<Point>, gaze: Gaze, right: number, up: number): Point {
  return along(eye, axesOf(gaze), [right, up, 0]);
}

/**
 * The eye after a share of the way to a point, at least `nearest` metres from it. It never reaches or passes
 * the point.
 */
export function approach(
  pivot: Readonly<Point>,
  eye: Readonly<Point>,
  share: number,
  nearest: number,
): Point {
  const way = Math.hypot(pivot[0] - eye[0], pivot[1] - eye[1], pivot[2] - eye[2]);
  const most = way > 0 ? Math.max(0, 1 - nearest / way) : 0;
  const part = Math.min(share, 0.5, most);
  const at = (axis: 0 | 1 | 2) => eye[axis] + (pivot[axis] - eye[axis]) * part;
  return [at(0), at(1), at(2)];
}
