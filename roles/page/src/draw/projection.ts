/** Projects points of the world to the canvas, and back. */

import { lerp, minus, type Point, pointOf } from "../space/point.ts";
import type { Size } from "../space/size.ts";
import type { Camera } from "./model.ts";
import { View } from "./view.ts";

/** A place on the canvas: CSS pixels from its upper left, and metres along the view. */
export interface Place {
  readonly x: number;
  readonly y: number;
  readonly depth: number;
}

const AXES: readonly [Point, Point, Point] = [
  [1, 0, 0],
  [0, 1, 0],
  [0, 0, 1],
];

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

  get size(): Size {
    return { width: this.#width, height: this.#height };
  }

  /** The projection of a point; nothing if it is before the near plane. */
  place(point: Point): Place | undefined {
    const inCamera = this.#inCamera(point);
    return -inCamera[2] < this.#camera.near ? undefined : this.#onCanvas(inCamera);
  }

  /** Metres from the eye to a point along the viewing direction. */
  depthOf(point: Point): number {
    return -this.#inCamera(point)[2];
  }

  /** Whether a point is within the picture. */
  shows(point: Point): boolean {
    const { x, y } = this.place(point) ?? { x: -1, y: -1 };
    return x >= 0 && y >= 0 && x <= this.#width && y <= this.#height;
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
      return -end[2] >= near ? end : lerp(end, other, share);
    };
    return [this.#onCanvas(clipped(a, b)), this.#onCanvas(clipped(b, a))];
  }

  /** The point of the world at a place. */
  point({ x, y, depth }: Place): Point {
    const right = ((2 * x) / this.#width - 1) * this.#view.tanX * depth;
    const up = (1 - (2 * y) / this.#height) * this.#view.tanY * depth;
    return pointOf((axis) => {
      const [x, y, z] = this.#rotated(AXES[axis]);
      return this.#camera.eye[axis] + (x * right + y * up - z * depth);
    });
  }

  /** How many metres a pixel is at a depth. */
  metresEach(depth: number): number {
    return this.heightAt(depth) / this.#height;
  }

  /** How many metres the picture is high at a depth. */
  heightAt(depth: number): number {
    return 2 * this.#view.tanY * depth;
  }

  #inCamera(point: Point): Point {
    return this.#rotated(minus(point, this.#camera.eye));
  }

  /** A direction of the world in camera space. */
  #rotated(way: Point): Point {
    return pointOf((axis) => this.#view.along(axis, ...way));
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
