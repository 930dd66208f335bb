/** A camera for drawing: transforms the world to camera space, and culls by the frustum. */

import type { Camera, Drawable } from "./model.ts";
import type { Region } from "./region.ts";

/** An axis-aligned box: its centre, and half of its sides. Six numbers. */
export type Bounds = Float64Array;

/** Numbers of a matrix of three rows and four columns. */
export const MATRIX = 12;

/** The error allowed in a test of a box, relative to its inputs: far less than a pixel. */
const SLACK = 1e-5;

/** An element of a list that is long enough. */
export function at(list: ArrayLike<number>, index: number): number {
  return list[index] ?? 0;
}

/**
 * One camera at a time, without allocation.
 *
 * All is computed in doubles relative to the eye, and rounded once. So precision does not suffer far from the
 * world's origin.
 */
export class View {
  /** The rows of the rotation from the world to camera space, one behind the other. */
  readonly #rows = new Float64Array(9);
  /** The matrix from the last `place`, row by row: from the local frame to camera space. */
  readonly matrix = new Float64Array(MATRIX);
  /** The eye, in the world, metres. */
  readonly eye: Float64Array = new Float64Array(3);
  /** Half of the picture's width and height at a distance of one. */
  tanX = 1;
  tanY = 1;
  near = 1;
  /** The sides of the drawn region at a distance of one: left, right, lower, upper. */
  readonly #sides = new Float64Array(4);

  /** Looks through `camera` at a picture of this many pixels. */
  set({ eye, orientation, tanHalfFov, near }: Camera, width: number, height: number): void {
    const [x, y, z, w] = orientation;
    const rows = this.#rows;
    rows[0] = 1 - 2 * (y * y + z * z);
    rows[1] = 2 * (x * y + z * w);
    rows[2] = 2 * (x * z - y * w);
    rows[3] = 2 * (x * y - z * w);
    rows[4] = 1 - 2 * (x * x + z * z);
    rows[5] = 2 * (y * z + x * w);
    rows[6] = 2 * (x * z + y * w);
    rows[7] = 2 * (y * z - x * w);
    rows[8] = 1 - 2 * (x * x + y * y);
    this.eye.set(eye);
    this.tanX = (tanHalfFov * width) / height;
    this.tanY = tanHalfFov;
    this.near = near;
    [this.#sides[0], this.#sides[1]] = [-this.tanX, this.tanX];
    [this.#sides[2], this.#sides[3]] = [-this.tanY, this.tanY];
  }

  /** Only a region of the picture is drawn from now on. */
  narrow({ of, left, bottom, width, height }: Region): void {
    const { tanX, tanY } = this;
    const side = (pixels: number, all: number, tan: number) => ((2 * pixels) / all - 1) * tan;
    this.#sides[0] = side(left, of.width, tanX);
    this.#sides[1] = side(left + width, of.width, tanX);
    this.#sides[2] = side(bottom, of.height, tanY);
    this.#sides[3] = side(bottom + height, of.height, tanY);
  }

  /** One coordinate in camera space of a direction of the world: 0 is x, 1 is y, 2 is z. */
  along(axis: number, x: number, y: number, z: number): number {
    const rows = this.#rows;
    return at(rows, 3 * axis) * x + at(rows, 3 * axis + 1) * y + at(rows, 3 * axis + 2) * z;
  }

  /** Computes the matrix of a drawable. */
  place({ origin, linear }: Drawable): void {
    const { matrix } = this;
    const x = origin[0] - at(this.eye, 0);
    const y = origin[1] - at(this.eye, 1);
    const z = origin[2] - at(this.eye, 2);
    for (let axis = 0; axis < 3; axis += 1) {
      const row = 4 * axis;
      matrix[row] = this.along(axis, at(linear, 0), at(linear, 1), at(linear, 2));
      matrix[row + 1] = this.along(axis, at(linear, 3), at(linear, 4), at(linear, 5));
      matrix[row + 2] = this.along(axis, at(linear, 6), at(linear, 7), at(linear, 8));
      matrix[row + 3] = this.along(axis, x, y, z);
    }
  }

  /** Whether a box, at the last `place`, may be in the picture, or in its region. */
  sees(bounds: Bounds): boolean {
    const sides = this.#sides;
    // The box is outside a side of the picture if its outermost corner is.
    return (
      this.#reach(bounds, 1, 0, at(sides, 0), 0) &&
      this.#reach(bounds, -1, 0, -at(sides, 1), 0) &&
      this.#reach(bounds, 0, 1, at(sides, 2), 0) &&
      this.#reach(bounds, 0, -1, -at(sides, 3), 0) &&
      this.#reach(bounds, 0, 0, -1, this.near)
    );
  }

  /** Whether the farthest corner of the box along (x, y, z) in camera space is that far. */
  #reach(bounds: Bounds, x: number, y: number, z: number, far: number): boolean {
    const { matrix } = this;
    let reached = x * at(matrix, 3) + y * at(matrix, 7) + z * at(matrix, 11);
    let size = Math.abs(reached);
    for (let axis = 0; axis < 3; axis += 1) {
      const slope = x * at(matrix, axis) + y * at(matrix, 4 + axis) + z * at(matrix, 8 + axis);
      const centre = slope * at(bounds, axis);
      const half = Math.abs(slope) * at(bounds, 3 + axis);
      reached += centre + half;
      size += Math.abs(centre) + half;
    }
    return reached + SLACK * size >= far;
  }
}
