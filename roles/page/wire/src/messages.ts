/**
 * Messages: a header of four bytes and a payload.
 *
 * A header is checked as soon as it arrives, so an invalid length is never waited for.
 */

import { Reader, WireError, Writer } from "./bytes.ts";

/** The kind of a message: the first byte of its header. */
export const Kind = {
  hello: 0x01,
  accept: 0x02,
  refuse: 0x03,
  close: 0x04,
  keepAlive: 0x05,
  channelsHello: 0x06,
  versionedAccept: 0x07,
  latestValue: 0x10,
  numberedValue: 0x11,
  begin: 0x20,
  batch: 0x21,
  end: 0x22,
  codedBatch: 0x24,
  message: 0x30,
  block: 0x40,
} as const;

export type Kind = (typeof Kind)[keyof typeof Kind];

/** The sizes of an application's data. WIRE.md calls them L, H and I. */
export interface Format {
  /** Bytes of a value of the latest lane. */
  readonly latest: number;
  /** Bytes of a frame's header, beside its number. */
  readonly header: number;
  /** Bytes of an item. */
  readonly item: number;
}

/** A received message. */
export interface Message {
  readonly kind: Kind;
  readonly payload: Uint8Array;
}

/** The least and the most bytes of a payload. */
export interface Lengths {
  readonly least: number;
  readonly most: number;
}

export const HEADER_BYTES = 4;

/** The most items of a batch. */
export const MOST_ITEMS = 16_384;

/** The most bytes of a message of the messages lane. */
export const MOST_MESSAGE = 16_384;

/** The most bytes of a block. */
export const MOST_BLOCK = 16_384;

/** The most bytes of an application's hello. */
export const MOST_INTRODUCTION = 200;

/** The length limits of this kind's payload. */
export function lengthsOf(kind: Kind, format: Format): Lengths {
  const [least, most] = KINDS[kind].lengths(format);
  return { least, most };
}

/** The name of a kind in texts for people. */
export function nameOfKind(kind: Kind): string {
  return KINDS[kind].name;
}

/** The message with its header. Throws if the payload's length is invalid. */
export function encodeMessage(kind: Kind, payload: Uint8Array, format: Format): Uint8Array<ArrayBuffer> {
  const { least, most } = lengthsOf(kind, format);
  if (payload.length < least || payload.length > most) {
    throw new RangeError(`a ${nameOfKind(kind)} of ${payload.length} bytes: it has ${least} to ${most}`);
  }
  return new Writer().u8(kind).u24(payload.length).bytes(payload).take();
}

/**
 * Finds the messages in a stream of bytes, however these are split.
 *
 * It holds only bytes that have arrived and not been taken, and reserves no memory for later ones. After a
 * bad header the stream is lost, and each further call throws the same error.
 */
export class MessageStream {
  readonly #format: Format;
  #bytes = new Uint8Array(0);
  #start = 0;
  #end = 0;

  constructor(format: Format) {
    this.#format = format;
  }

  /** How many bytes wait for the rest of their message: 0 if the stream may end. */
  get pending(): number {
    return this.#end - this.#start;
  }

  /** How much memory is held for received bytes. */
  get capacity(): number {
    return this.#bytes.length;
  }

  push(bytes: Uint8Array): void {
    if (this.#end + bytes.length > this.#bytes.length) {
      this.#makeRoom(bytes.length);
    }
    this.#bytes.set(bytes, this.#end);
    this.#end += bytes.length;
  }

  /** The next whole message; undefined if more bytes are needed. */
  take(): Message | undefined {
    if (this.pending < HEADER_BYTES) {
      return undefined;
    }
    const header = new Reader(this.#bytes.subarray(this.#start, this.#start + HEADER_BYTES));
    const [code, length] = [header.u8(), header.u24()];
    const kind = this.#judge(code, length);
    const from = this.#start + HEADER_BYTES;
    if (this.#end < from + length) {
      return undefined;
    }
    const payload = this.#bytes.slice(from, from + length);
    this.#start = from + length;
    return { kind, payload };
  }

  #judge(code: number, length: number): Kind {
    const kind = Object.values(Kind).find((kind) => kind === code);
    if (kind === undefined) {
      throw new WireError(`no message has the code ${code}: this is not a Trimaran peer`);
    }
    const { least, most } = lengthsOf(kind, this.#format);
    if (length < least || length > most) {
      throw new WireError(`a ${nameOfKind(kind)} cannot have ${length} bytes, only ${least} to ${most}`);
    }
    return kind;
  }

  /** Moves pending bytes to the front of enough memory. */
  #makeRoom(more: number): void {
    const pending = this.#bytes.subarray(this.#start, this.#end);
    const needed = pending.length + more;
    if (needed > this.#bytes.length) {
      const larger = new Uint8Array(Math.max(needed, Math.min(2 * this.#bytes.length, 1 << 18)));
      larger.set(pending);
      this.#bytes = larger;
    } else {
      this.#bytes.copyWithin(0, this.#start, this.#end);
    }
    this.#start = 0;
    this.#end = pending.length;
  }
}

/** By kind: its name, and the least and the most bytes of its payload. */
const KINDS: Readonly<Record<Kind, { name: string; lengths: (format: Format) => [number, number] }>> = {
  [Kind.hello]: { name: "hello", lengths: () => [2, MOST_INTRODUCTION + 58] },
  [Kind.accept]: { name: "accept", lengths: () => [1, MOST_INTRODUCTION + 5] },
  [Kind.refuse]: { name: "refuse", lengths: () => [2, 512] },
  [Kind.close]: { name: "close", lengths: () => [1, 256] },
  [Kind.keepAlive]: { name: "keep-alive", lengths: () => [0, 0] },
  [Kind.channelsHello]: { name: "hello with channels", lengths: () => [2, MOST_INTRODUCTION + 699] },
  [Kind.versionedAccept]: { name: "accept with version", lengths: () => [3, MOST_INTRODUCTION + 7] },
  [Kind.latestValue]: { name: "latest value", lengths: ({ latest }) => [latest, latest] },
  [Kind.numberedValue]: { name: "numbered value", lengths: ({ latest }) => [4 + latest, 4 + latest] },
  [Kind.begin]: { name: "begin", lengths: ({ header }) => [4 + header, 4 + header] },
  [Kind.batch]: { name: "batch", lengths: ({ item }) => [item, MOST_ITEMS * item] },
  [Kind.end]: { name: "end", lengths: () => [16, 16] },
  [Kind.codedBatch]: { name: "coded batch", lengths: ({ item }) => [1, MOST_ITEMS * item] },
  [Kind.message]: { name: "message", lengths: () => [0, MOST_MESSAGE] },
  [Kind.block]: { name: "block", lengths: () => [0, MOST_BLOCK] },
};
