/** The drawing order: the nearest box first, as in all displays. */

import { FRONT_SIDE } from "../proto/sides.ts";
import { facingOf, squaredDistance } from "./facing.ts";
import type { Drawable } from "./model.ts";
import { at, type View } from "./view.ts";

/** Bits of a float32 after its exponent. */
const MANTISSA = 23;

export class DrawOrder {
  /** The place of each drawable in the low word, and its sort key above it, to sort as single numbers. */
  #words = new Uint32Array(0);
  #distances = new Float32Array(0);
  #keys = new BigUint64Array(0);
  /** The visible sides of each drawable. */
  #facings = new Uint8Array(0);
  #count = 0;

  /**
   * Sorts `drawables` by the squared distance of the eye from their nodes' boxes (0 inside): first by its
   * power of two, then by the visible sides, and then by all of it, rounded to 32 bits and by one bit more.
   * Equal ones are in the order of their numbers.
   *
   * So one call draws many of them, and the nearest still come first. It allocates nothing unless the count
   * grows.
   */
  sort(view: View, drawables: readonly Drawable[]): void {
    this.#count = drawables.length;
    if (this.#count > this.#keys.length) {
      this.#keys = new BigUint64Array(2 * this.#count);
      this.#words = new Uint32Array(this.#keys.buffer);
      this.#distances = new Float32Array(this.#keys.buffer);
      this.#facings = new Uint8Array(2 * this.#count);
    }
    let place = 0;
    for (const drawable of drawables) {
      const facing = facingOf(drawable, view);
      this.#facings[place] = facing;
      this.#words[2 * place] = place;
      // The bits of non-negative floats are in the order of the numbers.
      this.#distances[2 * place + 1] = squaredDistance(view.eye, drawable, FRONT_SIDE);
      const bits = at(this.#words, 2 * place + 1);
      const mantissa = bits & ((1 << MANTISSA) - 1);
      this.#words[2 * place + 1] = ((bits >>> MANTISSA) << 24) | (facing << 22) | (mantissa >>> 1);
      place += 1;
    }
    this.#keys.subarray(0, this.#count).sort();
    this.#sortEqual(drawables);
  }

  /** The place in `drawables` of the one that is drawn after `before` others. */
  place(before: number): number {
    return at(this.#words, 2 * before);
  }

  /** The visible sides of the drawable at a place. */
  facing(place: number): number {
    return at(this.#facings, place);
  }

  /** Puts equally distant ones in the order of their numbers. */
  #sortEqual(drawables: readonly Drawable[]): void {
    const words = this.#words;
    const number = (place: number) => drawables[place]?.id ?? 0;
    for (let next = 1; next < this.#count; next += 1) {
      const [place, distance] = [this.place(next), words[2 * next + 1]];
      let before = next;
      while (
        before > 0 &&
        words[2 * before - 1] === distance &&
        number(this.place(before - 1)) > number(place)
      ) {
        words[2 * before] = this.place(before - 1);
        before -= 1;
      }
      words[2 * before] = place;
    }
  }
}
