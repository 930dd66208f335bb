/** Orbits a point, as if the model were turned in the hand. */

import { distance, dot, lerp, minus, type Point, pointOf } from "../space/point.ts";
import type { Gaze } from "./gaze.ts";

export type Axes = readonly [right: Point, up: Point, forward: Point];

/** The directions of a gaze: unit vectors of the world. */
export function axesOf(gaze: Gaze): Axes {
  const forward = gaze.forward;
  const right: Point = [Math.cos(gaze.heading), 0, -Math.sin(gaze.heading)];
  const up: Point = [
    right[1] * forward[2] - right[2] * forward[1],
    right[2] * forward[0] - right[0] * forward[2],
    right[0] * forward[1] - right[1] * forward[0],
  ];
  return [right, up, forward];
}

/** The steps to the right, upwards and ahead that make a step of the world. */
export function stepsOf(way: Point, axes: Axes): Point {
  return pointOf((axis) => dot(way, axes[axis]));
}

/** The place after `steps` to the right, upwards and ahead. */
export function along(from: Point, [right, up, forward]: Axes, steps: Point): Point {
  return pointOf((axis) => from[axis] + dot([right[axis], up[axis], forward[axis]], steps));
}

/** Turns the gaze, and returns the new eye for which the pivot stays at the same place of the picture. */
export function turnAbout(pivot: Point, eye: Point, gaze: Gaze, left: number, up: number): Point {
  const steps = stepsOf(minus(eye, pivot), axesOf(gaze));
  gaze.turn(left, up);
  return along(pivot, axesOf(gaze), steps);
}

/** Moves the eye this many metres to the right and upwards, across the viewing direction. */
export function pan(eye: Point, gaze: Gaze, right: number, up: number): Point {
  return along(eye, axesOf(gaze), [right, up, 0]);
}

/**
 * The eye after a share of the way to a point, at least `nearest` metres from it. It never reaches or passes
 * the point.
 */
export function approach(pivot: Point, eye: Point, share: number, nearest: number): Point {
  const way = distance(pivot, eye);
  const most = way > 0 ? Math.max(0, 1 - nearest / way) : 0;
  return lerp(eye, pivot, Math.min(share, 0.5, most));
}
