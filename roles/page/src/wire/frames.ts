/** Checks arrivals on the frames lane: order, count and hash. */

import { createXXHash3, type IHasher } from "hash-wasm";

import { Reader, WireError } from "./bytes.ts";
import { Kind, type Message } from "./messages.ts";

/** A frame with all its ids. */
export interface Frame {
  /** The lane's own number. */
  readonly number: number;
  /** The application's header of the frame. */
  readonly header: Uint8Array;
  /** Its items in the order in which they came. */
  readonly ids: Uint32Array<ArrayBuffer>;
}

/** Reads coded batches, in the application's own format. */
export interface BatchDecoder {
  /**
   * The ids of a batch of the frame of this number. Throws a `WireError` if they cannot be read, or are more
   * than `room`, before it allocates memory for them.
   */
  decode(batch: Uint8Array, frame: number, room: number): Uint32Array<ArrayBuffer>;
  /** Takes all ids of a frame, which the caller keeps. */
  complete(frame: number, ids: Uint32Array): void;
}

/** Loads XXH3-64, which is WebAssembly. */
export const loadHasher = createXXHash3;

/** The hash of all bytes since `init`. */
export function hashOf(hasher: IHasher): bigint {
  return BigInt(`0x${hasher.digest("hex")}`);
}

/** A frame that has begun and not ended. */
interface Open {
  readonly number: number;
  readonly header: Uint8Array;
  /** Room for ids; `count` of them are there. */
  ids: Uint32Array<ArrayBuffer>;
  count: number;
}

/** Assembles frames. After an error the peer cannot be trusted. */
export class FrameAssembler {
  readonly #hasher: IHasher;
  readonly #most: number;
  readonly #decoder: BatchDecoder | undefined;
  #open: Open | undefined;
  #last = -1;

  /** No frame may have more than `most` ids. Without a decoder no batch may be coded. */
  constructor(hasher: IHasher, most: number, decoder?: BatchDecoder) {
    [this.#hasher, this.#most, this.#decoder] = [hasher, most, decoder];
  }

  /** Takes the next message. Returns the frame that it ends, unless some of the ids are missing. */
  take({ kind, payload }: Message): Frame | undefined {
    switch (kind) {
      case Kind.begin:
        return this.#begin(new Reader(payload));
      case Kind.batch:
        return this.#addPlain(payload);
      case Kind.codedBatch:
        return this.#addCoded(payload);
      case Kind.end:
        return this.#end(new Reader(payload));
      default:
        throw new WireError("it is not of the frames lane");
    }
  }

  #begin(reader: Reader): undefined {
    const number = reader.u32();
    if (this.#open !== undefined) {
      throw new WireError(`frame ${number} began before the end of frame ${this.#open.number}`);
    }
    if (number <= this.#last) {
      throw new WireError(`frame ${number} began after frame ${this.#last}`);
    }
    this.#last = number;
    this.#hasher.init();
    this.#open = { number, header: reader.rest(), ids: new Uint32Array(0), count: 0 };
  }

  #addPlain(payload: Uint8Array): undefined {
    if (payload.length % ID_BYTES !== 0) {
      throw new WireError(`a batch of ${payload.length} bytes holds a part of an id`);
    }
    const count = payload.length / ID_BYTES;
    const open = this.#openFor(count);
    makeRoom(open, count, this.#most);
    new Uint8Array(open.ids.buffer).set(payload, ID_BYTES * open.count);
    this.#hasher.update(payload);
    open.count += count;
  }

  #addCoded(payload: Uint8Array): undefined {
    const open = this.#openFor(0);
    if (this.#decoder === undefined) {
      throw new WireError("a batch came coded, and was not asked for so");
    }
    const ids = this.#decoder.decode(payload, open.number, this.#most - open.count);
    this.#openFor(ids.length);
    makeRoom(open, ids.length, this.#most);
    open.ids.set(ids, open.count);
    this.#hasher.update(new Uint8Array(ids.buffer, ids.byteOffset, ids.byteLength));
    open.count += ids.length;
  }

  /** The begun frame, if it may have this many more ids. */
  #openFor(more: number): Open {
    if (this.#open === undefined) {
      throw new WireError("ids came outside of a frame");
    }
    if (this.#open.count + more > this.#most) {
      throw new WireError(`frame ${this.#open.number} has more than ${this.#most} ids`);
    }
    return this.#open;
  }

  #end(reader: Reader): Frame | undefined {
    const ended = { number: reader.u32(), announced: reader.u32(), hash: reader.u64() };
    const open = this.#open;
    if (open?.number !== ended.number) {
      throw new WireError(`frame ${ended.number} ended, and frame ${open?.number ?? "none"} was open`);
    }
    this.#open = undefined;
    if (open.count < ended.announced) {
      return undefined;
    }
    const hash = hashOf(this.#hasher);
    if (open.count > ended.announced || hash !== ended.hash) {
      throw new WireError(
        `the ${open.count} ids of frame ${open.number} are not those that its end announces`,
      );
    }
    const ids = open.ids.subarray(0, open.count);
    this.#decoder?.complete(open.number, ids);
    return { number: open.number, header: open.header, ids };
  }
}

/** Bytes of an uncoded id. Like WebGL, this page requires little-endian memory. */
const ID_BYTES = 4;

function makeRoom(open: Open, more: number, most: number): void {
  const needed = open.count + more;
  if (needed > open.ids.length) {
    const larger = new Uint32Array(Math.min(most, Math.max(needed, 2 * open.ids.length)));
    larger.set(open.ids.subarray(0, open.count));
    open.ids = larger;
  }
}
