/**
 * Ids coded as changes against a reference: the ids of an earlier frame, ascending and each once.
 *
 * A batch is runs over the reference: keep this many of its ids, skip this many, put these in between.
 */

import { type BatchDecoder, MOST_ITEMS, Reader, WireError } from "trimaran-transport";

/** How many complete frames are kept for reference. */
const MOST_FRAMES = 8;

/** A frame of more ids is not kept. */
const MOST_IDS = 262_144;

/** The largest id. */
const LARGEST = 0xffff_ffff;

/** The step after a run of kept ids: the lower two bits of its first number. */
const Step = { skipOne: 0, putOne: 1, skip: 2, put: 3 } as const;

/** The ids of a frame that is kept. */
interface Held {
  readonly frame: number;
  ids: Uint32Array;
  /** Whether the ids ascend. They are sorted on first use. */
  isRising: boolean;
}

/** Reads coded batches, and keeps the frames that they may refer to. */
export class IdDecoder implements BatchDecoder<Uint32Array<ArrayBuffer>> {
  #frames: Held[] = [];

  decode(batch: Uint8Array, frame: number, room: number): Uint32Array<ArrayBuffer> {
    const reader = new Reader(batch);
    const back = reader.varint32();
    const held = back === 0 ? NOTHING : this.#reference(frame, back);
    const place = back === 0 ? 0 : reader.varint32();
    const runs = new Runs(held, place, room);
    while (!reader.isAtEnd) {
      runs.take(reader);
    }
    return runs.ids();
  }

  complete(frame: number, ids: Uint32Array): void {
    if (ids.length > MOST_IDS) {
      return;
    }
    if (this.#frames.length === MOST_FRAMES) {
      this.#frames.shift();
    }
    this.#frames.push({ frame, ids: ids.slice(), isRising: false });
  }

  #reference(frame: number, back: number): Uint32Array {
    const held = this.#frames.find((held) => held.frame === frame - back);
    if (held === undefined) {
      throw new WireError(`ids refer to a frame ${back} before frame ${frame}, which is not held complete`);
    }
    if (!held.isRising) {
      held.ids = rising(held.ids);
      held.isRising = true;
    }
    return held.ids;
  }
}

/** The error in the ids of a frame of a scene with this many drawables, if there is one. */
export function faultOfIds(ids: Uint32Array, drawables: number): string | undefined {
  const sorted = isRising(ids) ? ids : ids.slice().sort();
  const largest = sorted.at(-1);
  if (largest !== undefined && largest >= drawables) {
    return `drawable ${largest} is not in the scene, which has ${drawables}`;
  }
  const twice = sorted.find((id, at) => sorted[at + 1] === id);
  return twice === undefined ? undefined : `drawable ${twice} comes twice in a frame`;
}

const NOTHING = new Uint32Array(0);

/** Reads runs over a reference into ids. */
class Runs {
  readonly #held: Uint32Array;
  readonly #room: number;
  #place: number;
  /** The least that the next id can be; beyond the largest if none can come. */
  #next: number;
  #ids = new Uint32Array(256);
  #count = 0;

  constructor(held: Uint32Array, place: number, room: number) {
    this.#held = held;
    this.#room = room;
    this.#place = place;
    const before = held[place - 1];
    this.#next = before === undefined ? 0 : before + 1;
  }

  /** The ids that were read. A batch has at least one. */
  ids(): Uint32Array<ArrayBuffer> {
    if (this.#count === 0) {
      throw new WireError("a batch of changes stands for no id");
    }
    return this.#ids.slice(0, this.#count);
  }

  take(reader: Reader): void {
    const run = reader.varint32();
    this.#keep(run >>> 2);
    switch (run & 3) {
      case Step.skipOne:
        this.#skip(1);
        break;
      case Step.skip:
        this.#skip(reader.varint32());
        break;
      case Step.putOne:
        this.#put(reader);
        break;
      default:
        this.#putMany(reader.varint32(), reader);
    }
  }

  #keep(count: number): void {
    const kept = this.#pass(count);
    this.#makeRoom(count);
    for (const id of kept) {
      this.#push(id);
    }
  }

  #skip(count: number): void {
    const last = this.#pass(count).at(-1);
    if (last !== undefined) {
      this.#next = Math.max(this.#next, last + 1);
    }
  }

  /** Each takes at least a byte, so a false count soon runs out of bytes. */
  #putMany(count: number, reader: Reader): void {
    for (let left = count; left > 0; left -= 1) {
      this.#put(reader);
    }
  }

  #put(reader: Reader): void {
    const gap = reader.varint32();
    this.#makeRoom(1);
    this.#push(this.#next + gap);
  }

  /** Consumes the next `count` ids of the reference. */
  #pass(count: number): Uint32Array {
    const end = this.#place + count;
    if (end > this.#held.length) {
      throw new WireError(`a run reaches beyond the ${this.#held.length} ids of its reference`);
    }
    const passed = this.#held.subarray(this.#place, end);
    this.#place = end;
    return passed;
  }

  #push(id: number): void {
    if (id < this.#next || id > LARGEST) {
      throw new WireError("the ids of a batch of changes do not rise within 32 bits");
    }
    this.#next = id + 1;
    this.#ids[this.#count] = id;
    this.#count += 1;
  }

  /** A few bytes can stand for many ids, so they are counted before memory is allocated. */
  #makeRoom(more: number): void {
    const count = this.#count + more;
    if (count > MOST_ITEMS) {
      throw new WireError(`a batch of changes stands for more than ${MOST_ITEMS} ids`);
    }
    if (count > this.#room) {
      throw new WireError(`a frame has more ids than it may: ${this.#room} were left`);
    }
    if (count > this.#ids.length) {
      const larger = new Uint32Array(Math.max(count, 2 * this.#ids.length));
      larger.set(this.#ids);
      this.#ids = larger;
    }
  }
}

/** The ids sorted, without duplicates. */
function rising(ids: Uint32Array): Uint32Array {
  return isRising(ids)
    ? ids
    : ids
        .slice()
        .sort()
        .filter((id, at, sorted) => sorted[at - 1] !== id);
}

function isRising(ids: Uint32Array): boolean {
  for (let at = 1; at < ids.length; at += 1) {
    if ((ids[at] ?? 0) <= (ids[at - 1] ?? 0)) {
      return false;
    }
  }
  return true;
}
