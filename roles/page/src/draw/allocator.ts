/** Places of varying length in a buffer that grows: the free ones are known, and neighbours joined. */

export interface Place {
  readonly offset: number;
  readonly length: number;
}

export class Allocator {
  /** Free places by offset, none touching the next. */
  readonly #free: { offset: number; length: number }[] = [];
  #capacity = 0;
  #used = 0;

  get capacity(): number {
    return this.#capacity;
  }

  /** What is taken, of the capacity. */
  get used(): number {
    return this.#used;
  }

  /** Adds room at the end. */
  grow(capacity: number): void {
    if (capacity > this.#capacity) {
      const added = { offset: this.#capacity, length: capacity - this.#capacity };
      this.#capacity = capacity;
      this.#insert(added);
    }
  }

  /** The smallest free place that is large enough; nothing if there is none. */
  take(length: number): Place | undefined {
    let best = -1;
    for (const [at, { length: free }] of this.#free.entries()) {
      if (free >= length && (best < 0 || free < (this.#free[best]?.length ?? 0))) {
        best = at;
      }
    }
    const place = this.#free[best];
    if (place === undefined || length === 0) {
      return length === 0 ? { offset: 0, length: 0 } : undefined;
    }
    const { offset } = place;
    if (place.length === length) {
      this.#free.splice(best, 1);
    } else {
      place.offset += length;
      place.length -= length;
    }
    this.#used += length;
    return { offset, length };
  }

  /** Gives back what `take` gave. */
  give({ offset, length }: Place): void {
    if (length > 0) {
      this.#used -= length;
      this.#insert({ offset, length });
    }
  }

  #insert(place: { offset: number; length: number }): void {
    let at = this.#free.findIndex(({ offset }) => offset > place.offset);
    at = at < 0 ? this.#free.length : at;
    const [before, after] = [this.#free[at - 1], this.#free[at]];
    if (after !== undefined && place.offset + place.length === after.offset) {
      after.offset = place.offset;
      after.length += place.length;
      place = after;
    } else {
      this.#free.splice(at, 0, place);
    }
    if (before !== undefined && before.offset + before.length === place.offset) {
      before.length += place.length;
      this.#free.splice(this.#free.indexOf(place), 1);
    }
  }
}
