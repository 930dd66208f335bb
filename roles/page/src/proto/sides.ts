/**
 * The visible sides of a drawable's triangles: both to eyes within a box, only the front to others.
 *
 * The box extends the drawable's by a distance at each of its six faces, four bits each: at the lower ends of
 * x, y and z first, then at the upper ones. 0 adds nothing, and 15 is unbounded. For any other n the distance
 * is 2^(n - 7) times the diagonal of the drawable's box.
 */

/** Both, to all eyes. */
export const BOTH_SIDES = 0xffffff;
/** Only the front, to eyes outside of the drawable's box. */
export const FRONT_SIDE = 0;

const FACES = [0, 1, 2, 3, 4, 5] as const;
const ENDLESS = 15;

/** How far the box around the eyes extends beyond a face of the drawable's, by its diagonal. */
export function reachOf(sides: number, face: number, diagonal: number): number {
  const n = (sides >>> (4 * face)) & 15;
  if (n === 0) {
    return 0;
  }
  return n === ENDLESS ? Number.POSITIVE_INFINITY : diagonal * 2 ** (n - 7);
}

/** Whether it is made of solids: the box around the eyes is bounded at all faces. */
export function isOfSolids(sides: number): boolean {
  return FACES.every((face) => ((sides >>> (4 * face)) & 15) !== ENDLESS);
}
