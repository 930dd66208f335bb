/** Projects points of the world to the canvas, and back. */

import type { Camera } from "../draw/model.ts";
import { View } from "../draw/view.ts";
import type { Point } from "../proto/viewState.ts";

/** A place on the canvas: CSS pixels from its upper left, and metres along the view. */
export interface Place {
  readonly x: number;
  readonly y: number;
  readonly depth: number;
}

const AXES = [
  [1, 0, 0],
  [0, 1, 0],
  [0, 0, 1],
] as const;

/** All is computed in doubles relative to the eye. */
export class Projection {
  readonly #view = new View();
  readonly #camera: Camera;
  readonly #width: number;
  readonly #height: number;

  /** For a canvas of this size in CSS pixels. */
  constructor(camera: Camera, width: number, height: number) {
    [this.#camera, this.#width, this.#height] = [camera, width, height];
    this.#view.set(camera, width, height);
  }

  get eye(): Point {
    return this.#camera.eye;
  }

  /** The projection of a point; nothing if it is before the near plane. */
  place(point: Point): Place | undefined {
    const inCamera = this.#inCamera(point);
    return -inCamera[2] < this.#camera.near ? undefined : this.#onCanvas(inCamera);
  }

  /** The part of a line between two points that is beyond the near plane. */
  line(from: Point, to: Point): readonly [Place, Place] | undefined {
    const [a, b] = [this.#inCamera(from), this.#inCamera(to)];
    // A little beyond it, in case of rounding.
    const near = 1.001 * this.#camera.near;
    if (-a[2] < near && -b[2] < near) {
      return undefined;
    }
    const clipped = (end: Point, other: Point): Point => {
      const share = (-near - end[2]) / (other[2] - end[2]);
      return -end[2] >= near ? end : (lerp(end, other, share) satisfies Point);
    };
    return [this.#onCanvas(clipped(a, b)), this.#onCanvas(clipped(b, a))];
  }

  /** The point of the world at a place. */
  point({ x, y, depth }: Place): Point {
    const right = ((2 * x) / this.#width - 1) * this.#view.tanX * depth;
    const up = (1 - (2 * y) / this.#height) * this.#view.tanY * depth;
    const at = (axis: 0 | 1 | 2) => {
      const [i, j, k] = AXES[axis];
      const view = this.#view;
      const rotated =
        view.along(0, i, j, k) * right + view.along(1, i, j, k) * up - view.along(2, i, j, k) * depth;
      return this.#camera.eye[axis] + rotated;
    };
    return [at(0), at(1), at(2)];
  }

  /** How many metres a pixel is at a depth. */
  metresEach(depth: number): number {
    return (2 * this.#view.tanY * depth) / this.#height;
  }

  #inCamera(point: Point): Point {
    const { eye } = this.#camera;
    const [x, y, z] = [point[0] - eye[0], point[1] - eye[1], point[2] - eye[2]];
    const view = this.#view;
    return [view.along(0, x, y, z), view.along(1, x, y, z), view.along(2, x, y, z)];
  }

  #onCanvas([right, up, back]: Point): Place {
    const depth = -back;
    return {
      x: (0.5 + right / (2 * depth * this.#view.tanX)) * this.#width,
      y: (0.5 - up / (2 * depth * this.#view.tanY)) * this.#height,
      depth,
    };
  }
}

/** Interpolates between two points: 0 is the first, 1 the second. */
export function lerp(from: Point, to: Point, share: number): Point {
  const at = (axis: 0 | 1 | 2) => from[axis] + (to[axis] - from[axis]) * share;
  return [at(0), at(1), at(2)];
}
