/** Sets of a scene's objects. A run of numbers takes no more room than a single one. */

import { type Reader, WireError, type Writer } from "../wire/bytes.ts";

/** The numbers from `first` to before `end`. */
export interface Run {
  readonly first: number;
  readonly end: number;
}

/** The largest number that an end can be: an object has a smaller one. */
const LARGEST = 0xffff_ffff;

export class ObjectSet {
  static readonly EMPTY = new ObjectSet([]);

  /** Ascending, none of them empty, none touching the next. */
  readonly runs: readonly Run[];

  private constructor(runs: readonly Run[]) {
    this.runs = runs;
  }

  /** These objects, in any order. */
  static of(objects: Iterable<number>): ObjectSet {
    const runs: { first: number; end: number }[] = [];
    for (const object of [...objects].sort((a, b) => a - b)) {
      if (!Number.isInteger(object) || object < 0 || object >= LARGEST) {
        throw new RangeError(`${object} is not the number of an object`);
      }
      const last = runs.at(-1);
      if (last !== undefined && last.end >= object) {
        last.end = object + 1;
      } else {
        runs.push({ first: object, end: object + 1 });
      }
    }
    return new ObjectSet(runs);
  }

  static read(reader: Reader): ObjectSet {
    const runs: Run[] = [];
    let least = 0;
    for (let left = reader.varintCount(); left > 0; left -= 1) {
      const first = least + reader.varint32();
      const end = first + reader.varint32() + 1;
      if (end > LARGEST) {
        throw new WireError(`a set of objects goes beyond number ${LARGEST - 1}`);
      }
      runs.push({ first, end });
      least = end + 1;
    }
    return new ObjectSet(runs);
  }

  write(writer: Writer): void {
    writer.varint(this.runs.length);
    let least = 0;
    for (const { first, end } of this.runs) {
      writer.varint(first - least).varint(end - first - 1);
      least = end + 1;
    }
  }

  get isEmpty(): boolean {
    return this.runs.length === 0;
  }

  has(object: number): boolean {
    let [low, high] = [0, this.runs.length];
    while (low < high) {
      const middle = (low + high) >>> 1;
      const run = this.runs[middle];
      if (run !== undefined && run.end <= object) {
        low = middle + 1;
      } else {
        high = middle;
      }
    }
    return (this.runs[low]?.first ?? LARGEST) <= object;
  }

  /** The objects, ascending. */
  *[Symbol.iterator](): Generator<number> {
    for (const { first, end } of this.runs) {
      for (let object = first; object < end; object += 1) {
        yield object;
      }
    }
  }
}
