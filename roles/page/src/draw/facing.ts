/** Which sides of a drawable's triangles are drawn. */

import type { Drawable } from "./model.ts";
import { at, type Bounds, type View } from "./view.ts";

/** Both sides. */
export const BOTH = 0;
/** Those whose corners are counter-clockwise. */
export const FRONT = 1;
/** Those whose corners are clockwise, as a mirror makes of fronts. */
export const MIRRORED = 2;
/** How many of these there are. */
export const FACINGS = 3;

/** How much farther than the corners of the near plane a solid must be: more than any rounding. */
const CLEARANCE = 1.01;

/**
 * The sides of a drawable that `view` has placed, with the box around its vertices.
 *
 * A solid shows its front alone, unless the near plane may cut it open: then its inside shows.
 */
export function facingOf({ sides, linear }: Drawable, bounds: Bounds, view: View): number {
  const { near, tanX, tanY } = view;
  const reach = CLEARANCE * near;
  if (sides !== 1 || view.distanceSquared(bounds) <= reach * reach * (1 + tanX * tanX + tanY * tanY)) {
    return BOTH;
  }
  const volume = determinant(linear);
  if (volume > 0) {
    return FRONT;
  }
  // What is flattened has no side that is its front.
  return volume < 0 ? MIRRORED : BOTH;
}

function determinant(m: ArrayLike<number>): number {
  return (
    at(m, 0) * (at(m, 4) * at(m, 8) - at(m, 5) * at(m, 7)) -
    at(m, 3) * (at(m, 1) * at(m, 8) - at(m, 2) * at(m, 7)) +
    at(m, 6) * (at(m, 1) * at(m, 5) - at(m, 2) * at(m, 4))
  );
}
