/** Distances between points that a person picks. */

import { signal } from "@preact/signals";
import type { Viewer } from "../viewer/viewer.ts";
import { type Distance, type Snapped, snap } from "./snap.ts";

export class Measuring {
  /** Clicks pick points, and no objects. */
  readonly isOn = signal(false);
  /** The point that was picked first, until there is a second one. */
  readonly start = signal<Snapped | undefined>(undefined);
  /** What is meant where the pointer is. */
  readonly hover = signal<Snapped | undefined>(undefined);
  readonly #viewer: Viewer;
  #isDue = false;

  constructor(viewer: Viewer) {
    this.#viewer = viewer;
    viewer.canvas.addEventListener("pointermove", (event) => {
      // A picture shows one marker: more need not be worked out.
      if (this.isOn.peek() && event.buttons === 0 && !this.#isDue) {
        this.#isDue = true;
        requestAnimationFrame(() => {
          this.#isDue = false;
          this.hover.value = this.at(event.offsetX, event.offsetY);
        });
      }
    });
  }

  toggle(): void {
    this.isOn.value = !this.isOn.value;
    [this.start.value, this.hover.value] = [undefined, undefined];
  }

  /** What is meant at a place of the canvas, in CSS pixels. */
  at(x: number, y: number): Snapped | undefined {
    const viewer = this.#viewer;
    const picked = viewer.pick(x, y);
    const drawable = viewer.display?.shown?.drawables.find(({ id }) => id === picked?.drawable);
    const triangles = drawable && viewer.renderer.triangles(drawable.geometry);
    if (picked === undefined || drawable === undefined || triangles === undefined) {
      return undefined;
    }
    return snap({ x, y, depth: picked.depth }, drawable, triangles, viewer.projection);
  }

  /** Picks a point: every second one ends a distance. */
  pick(x: number, y: number): void {
    const point = this.at(x, y);
    const start = this.start.peek();
    if (point === undefined || start === undefined) {
      this.start.value = point;
      return;
    }
    this.#viewer.distances.value = [...this.#viewer.distances.value, { from: start.point, to: point.point }];
    this.start.value = undefined;
  }

  remove(distance: Distance): void {
    this.#viewer.distances.value = this.#viewer.distances.value.filter((one) => one !== distance);
  }
}
