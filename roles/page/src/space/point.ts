/** Points and directions of the world. */

/** Metres for a point; y is up. */
export type Point = readonly [number, number, number];
export type Axis = 0 | 1 | 2;

/** The point with this coordinate on each axis. */
export function pointOf(coordinate: (axis: Axis) => number): Point {
  return [coordinate(0), coordinate(1), coordinate(2)];
}

export function dot(a: Point, b: Point): number {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

export function cross(a: Point, b: Point): Point {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}

export function minus(a: Point, b: Point): Point {
  return pointOf((axis) => a[axis] - b[axis]);
}

/** The place after `steps` along a direction. */
export function beyond(from: Point, direction: Point, steps: number): Point {
  return pointOf((axis) => from[axis] + direction[axis] * steps);
}

/** Interpolates between two points: 0 is the first, 1 the second. */
export function lerp(from: Point, to: Point, share: number): Point {
  return beyond(from, minus(to, from), share);
}

export function distance(a: Point, b: Point): number {
  return Math.hypot(...minus(a, b));
}
