/** The view frustum of an eye, and its projection. */

import type { Gaze, Point } from "./gaze.ts";
import { axesOf, dot } from "./orbit.ts";

export class Frustum {
  readonly #eye: Readonly<Point>;
  readonly #axes: readonly [Point, Point, Point];
  /** Half of the picture's width and height at a distance of one. */
  readonly tanX: number;
  readonly tanY: number;
  readonly #width: number;
  readonly #height: number;

  /** On a canvas of this size in CSS pixels. */
  constructor(eye: Readonly<Point>, gaze: Gaze, vfovDeg: number, width: number, height: number) {
    [this.#eye, this.#axes] = [eye, axesOf(gaze)];
    [this.#width, this.#height] = [Math.max(1, width), Math.max(1, height)];
    this.tanY = Math.tan((vfovDeg * Math.PI) / 360);
    this.tanX = (this.tanY * this.#width) / this.#height;
  }

  /** Metres from the eye along the viewing direction. */
  depthOf(point: Readonly<Point>): number {
    return this.#place(point)[2];
  }

  /** Whether a point is within the picture. */
  shows(point: Readonly<Point>): boolean {
    const [right, up, ahead] = this.#place(point);
    return ahead > 0 && Math.abs(right) <= this.tanX * ahead && Math.abs(up) <= this.tanY * ahead;
  }

  /** The distance of a point from a place of the canvas, CSS pixels; infinite if it is not in the picture. */
  offset(point: Readonly<Point>, x: number, y: number): number {
    const [right, up, ahead] = this.#place(point);
    const across = (1 + right / (this.tanX * ahead)) * 0.5 * this.#width;
    const down = (1 - up / (this.tanY * ahead)) * 0.5 * this.#height;
    return ahead > 0 ? Math.hypot(across - x, down - y) : Number.POSITIVE_INFINITY;
  }

  /** Metres to the right, upwards and ahead of the eye. */
  #place(point: Readonly<Point>): Point {
    const [x, y, z] = this.#eye;
    const way: Point = [point[0] - x, point[1] - y, point[2] - z];
    return [dot(way, this.#axes[0]), dot(way, this.#axes[1]), dot(way, this.#axes[2])];
  }
}
