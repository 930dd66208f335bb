/** Sets of a scene's objects. A run of numbers takes as much room as a single one. */

import { type Reader, WireError, type Writer } from "trimaran-transport";

/** The numbers from `first` to before `end`. */
export interface Run {
  readonly first: number;
  readonly end: number;
}

/** The largest possible end: an object has a smaller number. */
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

  /** The set of coded runs: the gap before each, and its length minus one. */
  static coded(pairs: Iterable<readonly [gap: number, more: number]>): ObjectSet {
    const runs: Run[] = [];
    let least = 0;
    for (const [gap, more] of pairs) {
      const first = least + gap;
      const end = first + more + 1;
      if (end > LARGEST) {
        throw new WireError(`a set of objects goes beyond number ${LARGEST - 1}`);
      }
      runs.push({ first, end });
      least = end + 1;
    }
    return new ObjectSet(runs);
  }

  /** The objects of ascending runs apart from each other. Runs that touch are joined. */
  static joined(runs: Iterable<Run>): ObjectSet {
    const joined: { first: number; end: number }[] = [];
    for (const { first, end } of runs) {
      const last = joined.at(-1);
      if (last?.end === first) {
        last.end = end;
      } else {
        joined.push({ first, end });
      }
    }
    return new ObjectSet(joined);
  }

  /** The objects from `first` to before `end`. */
  static run(first: number, end: number): ObjectSet {
    return first < end ? new ObjectSet([{ first, end }]) : ObjectSet.EMPTY;
  }

  static read(reader: Reader): ObjectSet {
    return ObjectSet.coded(pairsOf(reader));
  }

  write(writer: Writer): void {
    writer.varint(this.runs.length);
    for (const [gap, more] of this.pairs) {
      writer.varint(gap).varint(more);
    }
  }

  /** The set for `coded`. */
  get pairs(): (readonly [gap: number, more: number])[] {
    let least = 0;
    return this.runs.map(({ first, end }) => {
      const gap = first - least;
      least = end + 1;
      return [gap, end - first - 1] as const;
    });
  }

  get isEmpty(): boolean {
    return this.runs.length === 0;
  }

  get size(): number {
    return this.runs.reduce((sum, { first, end }) => sum + end - first, 0);
  }

  /** The objects of this set and those of the other one. */
  union(other: ObjectSet): ObjectSet {
    return this.#combine(other, (here, there) => here || there);
  }

  /** The objects of this set that are not in the other one. */
  minus(other: ObjectSet): ObjectSet {
    return this.#combine(other, (here, there) => here && !there);
  }

  /** Whether no object is in both. */
  isApartFrom(other: ObjectSet): boolean {
    return this.#combine(other, (here, there) => here && there).isEmpty;
  }

  /** Whether all objects of the other set are in this one. */
  covers(other: ObjectSet): boolean {
    return other.minus(this).isEmpty;
  }

  /** Whether both have the same objects. */
  equals(other: ObjectSet | undefined): boolean {
    return other !== undefined && this.covers(other) && other.covers(this);
  }

  /** Visits the places where one of two sets begins or ends. */
  #combine(other: ObjectSet, isIn: (here: boolean, there: boolean) => boolean): ObjectSet {
    const edges = [this, other].flatMap((set) => set.runs.flatMap(({ first, end }) => [first, end]));
    const runs: { first: number; end: number }[] = [];
    const places = [...new Set(edges)].sort((a, b) => a - b);
    for (const [index, first] of places.entries()) {
      const end = places[index + 1];
      if (end !== undefined && isIn(this.has(first), other.has(first))) {
        const last = runs.at(-1);
        if (last?.end === first) {
          last.end = end;
        } else {
          runs.push({ first, end });
        }
      }
    }
    return new ObjectSet(runs);
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

function* pairsOf(reader: Reader): Generator<readonly [gap: number, more: number]> {
  for (let left = reader.varintCount(); left > 0; left -= 1) {
    yield [reader.varint32(), reader.varint32()];
  }
}
