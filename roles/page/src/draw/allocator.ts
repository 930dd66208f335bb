/** Allocates ranges of a buffer: keeps the free ranges, and joins neighbours. */

export interface Place {
  readonly offset: number;
  readonly length: number;
}

interface Gap {
  offset: number;
  length: number;
}

/** Best fit: takes the smallest free range that is large enough, so that large ones stay whole. */
export class Allocator {
  /** Free ranges by offset; between two of them something is allocated. */
  readonly #gaps: Gap[];
  readonly capacity: number;
  /** The allocated part of the capacity. */
  used = 0;

  constructor(capacity: number) {
    this.capacity = capacity;
    this.#gaps = capacity > 0 ? [{ offset: 0, length: capacity }] : [];
  }

  /** How many free ranges there are. */
  get gaps(): number {
    return this.#gaps.length;
  }

  /** A range of that length; nothing if no free one is large enough. */
  take(length: number): Place | undefined {
    if (length === 0) {
      return { offset: 0, length: 0 };
    }
    let best: Gap | undefined;
    for (const gap of this.#gaps) {
      if (gap.length >= length && (best === undefined || gap.length < best.length)) {
        best = gap;
      }
    }
    if (best === undefined) {
      return undefined;
    }
    const { offset } = best;
    best.offset += length;
    best.length -= length;
    if (best.length === 0) {
      this.#gaps.splice(this.#gaps.indexOf(best), 1);
    }
    this.used += length;
    return { offset, length };
  }

  /** Frees a range from `take`. */
  give({ offset, length }: Place): void {
    if (length === 0) {
      return;
    }
    this.used -= length;
    const at = this.#firstBehind(offset);
    const [before, after] = [this.#gaps[at - 1], this.#gaps[at]];
    const touchesBefore = before !== undefined && before.offset + before.length === offset;
    const touchesAfter = after !== undefined && offset + length === after.offset;
    if (touchesBefore) {
      before.length += length + (touchesAfter ? after.length : 0);
      this.#gaps.splice(at, touchesAfter ? 1 : 0);
    } else if (touchesAfter) {
      after.offset = offset;
      after.length += length;
    } else {
      this.#gaps.splice(at, 0, { offset, length });
    }
  }

  /** The first gap behind an offset. */
  #firstBehind(offset: number): number {
    let [low, high] = [0, this.#gaps.length];
    while (low < high) {
      const middle = (low + high) >> 1;
      if ((this.#gaps[middle]?.offset ?? 0) > offset) {
        high = middle;
      } else {
        low = middle + 1;
      }
    }
    return low;
  }
}
