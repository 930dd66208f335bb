/**
 * Parallel projection, as a lens so long that its lines are almost parallel.
 *
 * The eye is a thousand picture heights before the plane that it is for. One height behind that plane, sizes
 * are 0.1 % less. Depth of 24 bits is as fine as 6e-5 heights there: a shorter lens is less parallel, and a
 * longer one makes depth coarser than a tenth of a pixel.
 */

import { beyond, dot, minus, type Point } from "../space/point.ts";
import type { CameraPose } from "./cameraHistory.ts";

export type ProjectionKind = "perspective" | "parallel";

/** The distance of the eye from the plane, in heights of the picture. */
export const HEIGHTS = 1000;
/** The vertical field of view, degrees: about 0.057. */
export const PARALLEL_DEG = (360 / Math.PI) * Math.atan(1 / (2 * HEIGHTS));
/** Text forms of the same number differ by less than this share. */
const ROUNDING = 1e-3;

/** Whether a vertical field of view in degrees is that of a parallel view. */
export function isParallel(vfovDeg: number): boolean {
  return Math.abs(vfovDeg - PARALLEL_DEG) <= ROUNDING * PARALLEL_DEG;
}

/** The tangent of half a field of view in degrees. */
export function tanOfHalf(vfovDeg: number): number {
  return Math.tan((vfovDeg * Math.PI) / 360);
}

/** An orthogonal camera, as files of notes have it. */
export interface OrthogonalCamera {
  readonly eye: Point;
  /** Metres from the lower to the upper side of the picture. */
  readonly height: number;
}

/**
 * The orthogonal camera of a parallel view, for the plane through a point. Its eye is at most `back` metres
 * before the point: other programs may not show what is far away. `forward` has length one.
 */
export function orthogonalOf(eye: Point, forward: Point, point: Point, back: number): OrthogonalCamera {
  const depth = Math.max(dot(minus(point, eye), forward), Number.EPSILON);
  return { eye: beyond(eye, forward, Math.max(0, depth - back)), height: depth / HEIGHTS };
}

/** The reverse: the pose with the height of an orthogonal camera in the plane through a point. */
export function poseOf({ eye, height }: OrthogonalCamera, way: Point, point: Point): CameraPose {
  const length = Math.hypot(...way) || 1;
  const forward = beyond([0, 0, 0], way, 1 / length);
  const depth = dot(minus(point, eye), forward);
  return {
    eye: beyond(eye, forward, depth - HEIGHTS * height),
    forward,
    vfovDeg: PARALLEL_DEG,
    mode: "orbit",
  };
}
