/** Checks arrivals on the frames lane: order, count and hash. */

import { createXXHash3, type IHasher } from "hash-wasm";

import { Reader, WireError } from "./bytes.ts";
import { whole } from "./codec.ts";
import { Kind, type Message } from "./messages.ts";
import type { Protocol } from "./protocol.ts";

/** A frame with all its items. */
export interface Frame<Header, Items> {
  /** It rises from frame to frame, and may have gaps. */
  readonly number: number;
  readonly header: Header;
  /** In the order in which they came. */
  readonly items: Items;
}

/** Reads coded batches, in the application's own format. */
export interface BatchDecoder<Items> {
  /**
   * The items of a batch of the frame of this number. Throws a `WireError` if they cannot be read, or are
   * more than `room`, before it allocates memory for them.
   */
  decode(batch: Uint8Array, frame: number, room: number): Items;
  /** Takes all items of a frame, which the caller keeps. */
  complete(frame: number, items: Items): void;
}

/** XXH3-64. */
export type Hasher = IHasher;

/** Loads XXH3-64, which is WebAssembly. */
export const loadHasher = createXXHash3;

/** The hashers of both directions. */
export type Hashers = readonly [receiving: Hasher, sending: Hasher];

export const loadHashers = (): Promise<Hashers> => Promise.all([loadHasher(), loadHasher()]);

/** The hash of all bytes since `init`. */
export function hashOf(hasher: Hasher): bigint {
  return BigInt(`0x${hasher.digest("hex")}`);
}

/** A frame that has begun and not ended. */
interface Open<Header> {
  readonly number: number;
  readonly header: Header;
  /** Room for items; those in the first `length` bytes are there. */
  bytes: Uint8Array<ArrayBuffer>;
  length: number;
}

/** The parts of a protocol that its frames need. */
export type FrameProtocol<Header, Items> = Pick<
  Protocol<unknown, unknown, Header, Items, unknown>,
  "header" | "items" | "decoder"
>;

/** Assembles frames. After an error the peer cannot be trusted. */
export class FrameAssembler<Header, Items> {
  readonly #hasher: Hasher;
  readonly #protocol: FrameProtocol<Header, Items>;
  readonly #decoder: BatchDecoder<Items> | undefined;
  readonly #most: number;
  #open: Open<Header> | undefined;
  #last = -1;

  /** No frame may have more than `most` items. */
  constructor(hasher: Hasher, protocol: FrameProtocol<Header, Items>, most: number) {
    [this.#hasher, this.#protocol, this.#most] = [hasher, protocol, most];
    this.#decoder = protocol.decoder?.();
  }

  /** Takes the next message. Returns the frame that it ends, unless some items are missing. */
  take({ kind, payload }: Message): Frame<Header, Items> | undefined {
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
    const header = whole(this.#protocol.header).decode(reader.rest());
    this.#open = { number, header, bytes: new Uint8Array(0), length: 0 };
  }

  #addPlain(payload: Uint8Array): undefined {
    const { size } = this.#protocol.items;
    if (payload.length % size !== 0) {
      throw new WireError(`a batch of ${payload.length} bytes holds a part of an item`);
    }
    const open = this.#openFor(payload.length / size);
    makeRoom(open, payload.length, this.#most * size);
    open.bytes.set(payload, open.length);
    this.#hasher.update(payload);
    open.length += payload.length;
  }

  #addCoded(payload: Uint8Array): undefined {
    const { number, length } = this.#openFor(0);
    if (this.#decoder === undefined) {
      throw new WireError("a batch came coded, and was not asked for so");
    }
    const { items } = this.#protocol;
    const room = this.#most - length / items.size;
    this.#addPlain(items.encode(this.#decoder.decode(payload, number, room)));
  }

  /** The begun frame, if it may have this many more items. */
  #openFor(more: number): Open<Header> {
    if (this.#open === undefined) {
      throw new WireError("items came outside of a frame");
    }
    if (this.#open.length / this.#protocol.items.size + more > this.#most) {
      throw new WireError(`frame ${this.#open.number} has more than ${this.#most} items`);
    }
    return this.#open;
  }

  #end(reader: Reader): Frame<Header, Items> | undefined {
    const ended = { number: reader.u32(), announced: reader.u32(), hash: reader.u64() };
    const open = this.#open;
    if (open?.number !== ended.number) {
      throw new WireError(`frame ${ended.number} ended, and frame ${open?.number ?? "none"} was open`);
    }
    this.#open = undefined;
    const { number, header } = open;
    const count = open.length / this.#protocol.items.size;
    if (count < ended.announced) {
      return undefined;
    }
    const hash = hashOf(this.#hasher);
    if (count > ended.announced || hash !== ended.hash) {
      throw new WireError(`the ${count} items of frame ${number} are not those that its end announces`);
    }
    const items = this.#protocol.items.decode(open.bytes.subarray(0, open.length));
    this.#decoder?.complete(number, items);
    return { number, header, items };
  }
}

function makeRoom(open: Open<unknown>, more: number, most: number): void {
  const needed = open.length + more;
  if (needed > open.bytes.length) {
    const larger = new Uint8Array(Math.min(most, Math.max(needed, 2 * open.bytes.length)));
    larger.set(open.bytes.subarray(0, open.length));
    open.bytes = larger;
  }
}
