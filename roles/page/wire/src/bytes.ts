/**
 * Bytes on the wire: numbers of fixed width are little-endian, and the rest is postcard.
 *
 * postcard writes integers wider than a byte as varints: 7 bits a byte, low bits first, the top bit set on
 * all but the last.
 */

import type { Layout } from "./fixed.ts";

/** Bytes violate the wire format. The peer cannot be trusted after that. */
export class WireError extends Error {
  override name = "WireError";
}

/** Reads values off the front of bytes. Throws a `WireError` for missing or invalid ones. */
export class Reader {
  readonly #bytes: Uint8Array;
  readonly #view: DataView;
  #position = 0;

  constructor(bytes: Uint8Array) {
    this.#bytes = bytes;
    this.#view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  }

  /** How many bytes were read. */
  get position(): number {
    return this.#position;
  }

  get isAtEnd(): boolean {
    return this.#position === this.#bytes.length;
  }

  /** Checks that nothing follows. */
  end(): void {
    if (!this.isAtEnd) {
      throw new WireError(`${this.#bytes.length - this.#position} bytes too many`);
    }
  }

  u8(): number {
    return this.#view.getUint8(this.#pass(1));
  }

  u16(): number {
    return this.#view.getUint16(this.#pass(2), true);
  }

  u24(): number {
    const at = this.#pass(3);
    return this.#view.getUint16(at, true) | (this.#view.getUint8(at + 2) << 16);
  }

  u32(): number {
    return this.#view.getUint32(this.#pass(4), true);
  }

  u64(): bigint {
    return this.#view.getBigUint64(this.#pass(8), true);
  }

  f32(): number {
    return this.#view.getFloat32(this.#pass(4), true);
  }

  f64(): number {
    return this.#view.getFloat64(this.#pass(8), true);
  }

  /** A value of fixed size. */
  fixed<T>({ size, get }: Layout<T>): T {
    return get(this.#view, this.#pass(size));
  }

  /** This many bytes, as a view into the buffer. */
  bytes(count: number): Uint8Array {
    const at = this.#pass(count);
    return this.#bytes.subarray(at, at + count);
  }

  /** All bytes that are left, perhaps none. */
  rest(): Uint8Array {
    return this.bytes(this.#bytes.length - this.#position);
  }

  /** A postcard u16. */
  varint16(): number {
    return this.#smallVarint(16);
  }

  /** A postcard u32. */
  varint32(): number {
    return this.#smallVarint(32);
  }

  /** A postcard u64. */
  varint64(): bigint {
    return this.#largeVarint(64);
  }

  /** A postcard u64 that is a count: below 2^53, to be exact. */
  varintCount(): number {
    const value = this.#largeVarint(64);
    if (value > BigInt(Number.MAX_SAFE_INTEGER)) {
      throw new WireError(`a count of ${value} is beyond 53 bits`);
    }
    return Number(value);
  }

  /** A postcard u128. */
  varint128(): bigint {
    return this.#largeVarint(128);
  }

  /** A postcard bool. */
  bool(): boolean {
    const value = this.u8();
    if (value > 1) {
      throw new WireError(`${value} is neither no nor yes`);
    }
    return value === 1;
  }

  /** A postcard option. */
  option<T>(read: () => T): T | undefined {
    return this.bool() ? read() : undefined;
  }

  /** A postcard enum without values: one of these names, by its number. */
  variant<T extends string>(names: readonly T[]): T {
    const number = this.varint32();
    const name = names[number];
    if (name === undefined) {
      throw new WireError(`${number} is none of ${names.join(", ")}`);
    }
    return name;
  }

  /** postcard bytes: their count, then the bytes. */
  byteString(): Uint8Array {
    return this.bytes(this.varintCount());
  }

  /** A postcard text of at most this many bytes of UTF-8. */
  text(most = Number.POSITIVE_INFINITY): string {
    const bytes = this.byteString();
    if (bytes.length > most) {
      throw new WireError(`a text of ${bytes.length} bytes is longer than ${most}`);
    }
    try {
      return new TextDecoder("utf-8", { fatal: true, ignoreBOM: true }).decode(bytes);
    } catch {
      throw new WireError("a text is not UTF-8");
    }
  }

  /** Advances by `count` bytes and returns where they begin. */
  #pass(count: number): number {
    const at = this.#position;
    if (count > this.#bytes.length - at) {
      throw new WireError(`cut short: ${count} bytes expected, ${this.#bytes.length - at} left`);
    }
    this.#position = at + count;
    return at;
  }

  #smallVarint(bits: number): number {
    let value = 0;
    for (let shift = 0; shift < bits; shift += 7) {
      const byte = this.u8();
      value += (byte & 0x7f) * 2 ** shift;
      if (byte < 0x80) {
        return this.#within(value, 2 ** bits, bits);
      }
    }
    throw new WireError(`a number is longer than ${bits} bits`);
  }

  #largeVarint(bits: number): bigint {
    let value = 0n;
    for (let shift = 0; shift < bits; shift += 7) {
      const byte = this.u8();
      value |= BigInt(byte & 0x7f) << BigInt(shift);
      if (byte < 0x80) {
        return this.#within(value, 1n << BigInt(bits), bits);
      }
    }
    throw new WireError(`a number is longer than ${bits} bits`);
  }

  #within<T extends number | bigint>(value: T, above: T, bits: number): T {
    if (value >= above) {
      throw new WireError(`the number ${value} is above ${bits} bits`);
    }
    return value;
  }
}

/** Writes values one after the other into a growing buffer. */
export class Writer {
  #bytes = new Uint8Array(64);
  #view = new DataView(this.#bytes.buffer);
  #length = 0;

  /** How many bytes were written. */
  get length(): number {
    return this.#length;
  }

  /** A copy of the written bytes. */
  take(): Uint8Array<ArrayBuffer> {
    return this.#bytes.slice(0, this.#length);
  }

  u8(value: number): this {
    return this.#put(1, (view, at) => view.setUint8(at, value));
  }

  u16(value: number): this {
    return this.#put(2, (view, at) => view.setUint16(at, value, true));
  }

  u24(value: number): this {
    return this.u16(value & 0xffff).u8(value >>> 16);
  }

  u32(value: number): this {
    return this.#put(4, (view, at) => view.setUint32(at, value, true));
  }

  u64(value: bigint): this {
    return this.#put(8, (view, at) => view.setBigUint64(at, value, true));
  }

  f32(value: number): this {
    return this.#put(4, (view, at) => view.setFloat32(at, value, true));
  }

  f64(value: number): this {
    return this.#put(8, (view, at) => view.setFloat64(at, value, true));
  }

  /** A value of fixed size. */
  fixed<T>({ size, set }: Layout<T>, value: T): this {
    return this.#put(size, (view, at) => set(view, at, value));
  }

  bytes(bytes: Uint8Array): this {
    const at = this.#room(bytes.length);
    this.#bytes.set(bytes, at);
    return this;
  }

  /** A postcard integer of any width: a whole number that is not negative. */
  varint(value: number | bigint): this {
    if (typeof value === "number" && !Number.isSafeInteger(value)) {
      throw new RangeError(`${value} is no whole number that can be written exactly`);
    }
    let rest = BigInt(value);
    if (rest < 0n) {
      throw new RangeError(`${value} is negative`);
    }
    while (rest >= 0x80n) {
      this.u8(Number(rest & 0x7fn) | 0x80);
      rest >>= 7n;
    }
    return this.u8(Number(rest));
  }

  /** A postcard bool. */
  bool(value: boolean): this {
    return this.u8(value ? 1 : 0);
  }

  /** A postcard option. */
  option<T>(value: T | undefined, write: (value: T) => void): this {
    this.bool(value !== undefined);
    if (value !== undefined) {
      write(value);
    }
    return this;
  }

  /** A postcard enum without values: the number of `name` among `names`. */
  variant<T extends string>(names: readonly T[], name: T): this {
    return this.varint(names.indexOf(name));
  }

  /** postcard bytes: their count, then the bytes. */
  byteString(bytes: Uint8Array): this {
    return this.varint(bytes.length).bytes(bytes);
  }

  /** A postcard text. */
  text(text: string): this {
    return this.byteString(new TextEncoder().encode(text));
  }

  #put(count: number, set: (view: DataView, at: number) => void): this {
    const at = this.#room(count);
    set(this.#view, at);
    return this;
  }

  /** Makes room for `count` more bytes and returns where they begin. May replace the view. */
  #room(count: number): number {
    const at = this.#length;
    this.#length += count;
    if (this.#length > this.#bytes.length) {
      const larger = new Uint8Array(Math.max(this.#length, 2 * this.#bytes.length));
      larger.set(this.#bytes);
      this.#bytes = larger;
      this.#view = new DataView(larger.buffer);
    }
    return at;
  }
}

/** A random number of 64 bits. */
export function randomNumber(): bigint {
  return crypto.getRandomValues(new BigUint64Array(1))[0] ?? 0n;
}

/** The text, cut after the last whole character within `most` bytes of UTF-8. */
export function cutText(text: string, most: number): string {
  const bytes = new Uint8Array(most);
  const { read } = new TextEncoder().encodeInto(text, bytes);
  return text.slice(0, read);
}

/** A peer's text for display: control characters are escaped. */
export function shownText(text: string): string {
  return text.replace(/\p{Cc}/gu, (control) => `\\u{${control.codePointAt(0)?.toString(16)}}`);
}
