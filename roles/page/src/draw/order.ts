/** In which order drawables are drawn: the nearest box first, as in all displays. */

import type { Camera, Drawable } from "./model.ts";

export class DrawOrder {
  /** Of each drawable its place, and above that its distance: words of one number to sort by. */
  #words = new Uint32Array(0);
  #distances = new Float32Array(0);
  #keys = new BigUint64Array(0);
  #count = 0;

  /**
   * Sorts `drawables` by the squared distance of the eye from their nodes' boxes (0 inside, rounded to 32
   * bits), then by number. It takes no memory where there were as many before.
   */
  sort(eye: Camera["eye"], drawables: readonly Drawable[]): void {
    this.#count = drawables.length;
    if (this.#count > this.#keys.length) {
      this.#keys = new BigUint64Array(2 * this.#count);
      this.#words = new Uint32Array(this.#keys.buffer);
      this.#distances = new Float32Array(this.#keys.buffer);
    }
    let at = 0;
    for (const drawable of drawables) {
      this.#words[2 * at] = at;
      // The bits of numbers that are not negative are in the order of the numbers.
      this.#distances[2 * at + 1] = squaredDistance(eye, drawable);
      at += 1;
    }
    this.#keys.subarray(0, this.#count).sort();
    this.#sortEqual(drawables);
  }

  /** The place in `drawables` of the one that is drawn after `before` others. */
  place(before: number): number {
    return this.#words[2 * before] ?? 0;
  }

  /** Puts those that are as far away in the order of their numbers. */
  #sortEqual(drawables: readonly Drawable[]): void {
    const words = this.#words;
    const number = (at: number) => drawables[at]?.id ?? 0;
    for (let next = 1; next < this.#count; next += 1) {
      const [place, distance] = [this.place(next), words[2 * next + 1]];
      let at = next;
      while (at > 0 && words[2 * at - 1] === distance && number(this.place(at - 1)) > number(place)) {
        words[2 * at] = this.place(at - 1);
        at -= 1;
      }
      words[2 * at] = place;
    }
  }
}

function squaredDistance(eye: Camera["eye"], { worldMin, worldMax }: Drawable): number {
  const x = Math.max(worldMin[0] - eye[0], eye[0] - worldMax[0], 0);
  const y = Math.max(worldMin[1] - eye[1], eye[1] - worldMax[1], 0);
  const z = Math.max(worldMin[2] - eye[2], eye[2] - worldMax[2], 0);
  return x * x + y * y + z * z;
}
