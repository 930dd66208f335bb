/** A camera as drawing needs it: what turns the world to camera space. */

import type { Camera } from "../proto/camera.ts";

/** Three numbers, or the rows of a matrix one behind the other. */
export type Numbers = readonly number[];

/** The rows of the rotation from the world to camera space. */
export function worldToCamera([x, y, z, w]: readonly [number, number, number, number]): Numbers {
  return [
    1 - 2 * (y * y + z * z),
    2 * (x * y + z * w),
    2 * (x * z - y * w),
    2 * (x * y - z * w),
    1 - 2 * (x * x + z * z),
    2 * (y * z + x * w),
    2 * (x * z + y * w),
    2 * (y * z - x * w),
    1 - 2 * (x * x + y * y),
  ];
}

/** A direction of the world in camera space, of length one. */
export function turned(
  rows: Numbers,
  [x, y, z]: readonly [number, number, number],
): [number, number, number] {
  const along = (row: number) => (rows[row] ?? 0) * x + (rows[row + 1] ?? 0) * y + (rows[row + 2] ?? 0) * z;
  const [a, b, c] = [along(0), along(3), along(6)];
  const length = Math.hypot(a, b, c);
  return [a / length, b / length, c / length];
}

/** What a drawable is drawn by. */
export interface Placed {
  readonly origin: readonly [number, number, number];
  readonly linear: readonly number[];
}

/**
 * Writes the rows of the matrix from a drawable's local frame to camera space at `out[at]`, 12 numbers.
 *
 * All is worked out in doubles and rounded once, so that nothing far from the world's origin is coarse.
 */
export function writeRows(
  out: Float32Array,
  at: number,
  rows: Numbers,
  eye: Camera["eye"],
  { origin, linear }: Placed,
): void {
  const [dx, dy, dz] = [origin[0] - eye[0], origin[1] - eye[1], origin[2] - eye[2]];
  for (let row = 0; row < 3; row += 1) {
    const [a, b, c] = [rows[3 * row] ?? 0, rows[3 * row + 1] ?? 0, rows[3 * row + 2] ?? 0];
    for (let column = 0; column < 3; column += 1) {
      out[at + 4 * row + column] =
        a * (linear[3 * column] ?? 0) + b * (linear[3 * column + 1] ?? 0) + c * (linear[3 * column + 2] ?? 0);
    }
    out[at + 4 * row + 3] = a * dx + b * dy + c * dz;
  }
}
