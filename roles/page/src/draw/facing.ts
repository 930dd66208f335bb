/** The sides of a drawable's triangles to draw. */

import { BOTH_SIDES, FRONT_SIDE, reachOf } from "../proto/sides.ts";
import type { Drawable } from "./model.ts";
import { at, type View } from "./view.ts";

/** Both sides. */
export const BOTH = 0;
/** Triangles with counter-clockwise corners. */
export const FRONT = 1;
/** Triangles with clockwise corners, as mirroring makes of fronts. */
export const MIRRORED = 2;
/** How many of these there are. */
export const FACINGS = 3;

/** How far a solid must be, relative to the corners of the near plane: exceeds any rounding. */
const CLEARANCE = 1.01;

/**
 * The visible sides of a drawable.
 *
 * A solid shows only its front, unless the eye may see into it, or the near plane may cut it open.
 */
export function facingOf(drawable: Drawable, view: View): number {
  const { near, tanX, tanY } = view;
  const reach = CLEARANCE * near;
  if (
    drawable.sides === BOTH_SIDES ||
    squaredDistance(view.eye, drawable, drawable.sides) <= reach * reach * (1 + tanX * tanX + tanY * tanY)
  ) {
    return BOTH;
  }
  const volume = determinant(drawable.linear);
  if (volume > 0) {
    return FRONT;
  }
  // A flattened drawable has no front.
  return volume < 0 ? MIRRORED : BOTH;
}

/** From an eye to the box around the eyes to which both `sides` are visible, 0 within it; square metres. */
export function squaredDistance(
  eye: ArrayLike<number>,
  { worldMin, worldMax }: Drawable,
  sides: number,
): number {
  const diagonal = sides === FRONT_SIDE ? 0 : Math.sqrt(squaredDiagonal(worldMin, worldMax));
  let sum = 0;
  for (let axis = 0; axis < 3; axis += 1) {
    const below = at(worldMin, axis) - reachOf(sides, axis, diagonal) - at(eye, axis);
    const above = at(eye, axis) - at(worldMax, axis) - reachOf(sides, axis + 3, diagonal);
    const gap = Math.max(0, below, above);
    sum += gap * gap;
  }
  return sum;
}

function squaredDiagonal(low: ArrayLike<number>, high: ArrayLike<number>): number {
  const [x, y, z] = [at(high, 0) - at(low, 0), at(high, 1) - at(low, 1), at(high, 2) - at(low, 2)];
  return x * x + y * y + z * z;
}

function determinant(m: ArrayLike<number>): number {
  return (
    at(m, 0) * (at(m, 4) * at(m, 8) - at(m, 5) * at(m, 7)) -
    at(m, 3) * (at(m, 1) * at(m, 8) - at(m, 2) * at(m, 7)) +
    at(m, 6) * (at(m, 1) * at(m, 5) - at(m, 2) * at(m, 4))
  );
}
