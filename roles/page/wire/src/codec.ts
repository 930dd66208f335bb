/** Formats of values. One description serves reading and writing. */

import { cutText, Reader, WireError, Writer } from "./bytes.ts";
import { type Fixed, fixed, number } from "./fixed.ts";

export interface Codec<T> {
  /** Throws a `WireError` for missing or invalid bytes. */
  read(reader: Reader): T;
  write(writer: Writer, value: T): void;
}

/** The values of a codec. */
export type Of<C> = C extends Codec<infer T> ? T : never;

type Codecs = Readonly<Record<string, Codec<unknown>>>;
/** An object with the values of codecs, by name. */
export type Fields<F extends Codecs> = { readonly [Name in keyof F]: Of<F[Name]> };
/** One of several objects: the value of `Tag` says which. */
type Tagged<Tag extends string, Cases extends Readonly<Record<string, Codecs>>> = {
  [Name in keyof Cases]: { readonly [Key in Tag]: Name } & Fields<Cases[Name]>;
}[keyof Cases];

/** Numbers of fixed width, in postcard as well. */
export const u8 = number("u8");
export const i8 = number("i8");
export const f32 = number("f32");
export const f64 = number("f64");

const varint = <T extends number | bigint>(read: (reader: Reader) => T): Codec<T> => {
  return { read, write: (w, value) => w.varint(value) };
};
/** Integers of postcard. */
export const u16 = varint((r) => r.varint16());
export const u32 = varint((r) => r.varint32());
export const u64 = varint((r) => r.varint64());
export const u128 = varint((r) => r.varint128());
const signed = (unsigned: Codec<number>): Codec<number> => ({
  read(r) {
    const folded = unsigned.read(r);
    return (folded >>> 1) ^ -(folded & 1);
  },
  write: (w, value) => unsigned.write(w, ((value << 1) ^ (value >> 31)) >>> 0),
});
export const i16 = signed(u16);
export const i32 = signed(u32);
export const i64: Codec<bigint> = {
  read(r) {
    const folded = u64.read(r);
    return (folded >> 1n) ^ -(folded & 1n);
  },
  write: (w, value) => u64.write(w, BigInt.asUintN(64, (value << 1n) ^ (value >> 63n))),
};
/** A u64 that is a count: below 2^53, to be exact. */
export const count = varint((r) => r.varintCount());

export const bool: Codec<boolean> = { read: (r) => r.bool(), write: (w, value) => w.bool(value) };
/** Bytes behind their count. */
export const bytes: Codec<Uint8Array> = {
  read: (r) => r.byteString(),
  write: (w, value) => w.byteString(value),
};
/** All bytes that follow. */
export const rest: Codec<Uint8Array> = { read: (r) => r.rest(), write: (w, value) => w.bytes(value) };

/** A text. With `most`, it is cut to that many bytes of UTF-8, and a longer one is not read. */
export function text(most?: number): Codec<string> {
  return {
    read: (r) => r.text(most),
    write: (w, value) => w.text(most === undefined ? value : cutText(value, most)),
  };
}

export function option<T>({ read, write }: Codec<T>): Codec<T | undefined> {
  return {
    read: (r) => r.option(() => read(r)),
    write: (w, value) => w.option(value, (value) => write(w, value)),
  };
}

/** Several values behind their count. `what` names them in the error about more than `most`. */
export function list<T>({ read, write }: Codec<T>, most: number, what: string): Codec<readonly T[]> {
  return {
    read(r) {
      const length = r.varintCount();
      if (length > most) {
        throw new WireError(`${length} ${what}: there can be ${most}`);
      }
      return Array.from({ length }, () => read(r));
    },
    write(w, values) {
      w.varint(values.length);
      for (const value of values) {
        write(w, value);
      }
    },
  };
}

/** One of these names, by its number. */
export function variant<T extends string>(names: readonly T[]): Codec<T> {
  return { read: (r) => r.variant(names), write: (w, name) => w.variant(names, name) };
}

/** The fields of an object, in order. */
export function record<F extends Codecs>(fields: F): Codec<Fields<F>> {
  const all = Object.entries(fields);
  return {
    read: (r) => Object.fromEntries(all.map(([name, codec]) => [name, codec.read(r)])) as Fields<F>,
    write(w, value) {
      for (const [name, codec] of all) {
        codec.write(w, value[name]);
      }
    },
  };
}

/** One of several objects: a number for the name in its field `tag`, and then its other fields. */
export function tagged<Tag extends string, Cases extends Readonly<Record<string, Codecs>>>(
  tag: Tag,
  cases: Cases,
): Codec<Tagged<Tag, Cases>> {
  const names = variant(Object.keys(cases));
  const codecs = new Map(Object.entries(cases).map(([name, fields]) => [name, record(fields)]));
  return {
    read(r) {
      const name = names.read(r);
      return { [tag]: name, ...codecs.get(name)?.read(r) } as Tagged<Tag, Cases>;
    },
    write(w, value) {
      const name = String(value[tag]);
      names.write(w, name);
      codecs.get(name)?.write(w, value);
    },
  };
}

/** Refuses the values that have a fault when they are read. */
export function checked<T>(codec: Fixed<T>, faultOf: (value: T) => string | undefined): Fixed<T>;
export function checked<T>(codec: Codec<T>, faultOf: (value: T) => string | undefined): Codec<T>;
export function checked<T>(
  codec: Codec<T> | Fixed<T>,
  faultOf: (value: T) => string | undefined,
): Codec<T> | Fixed<T> {
  const check = (value: T) => {
    const fault = faultOf(value);
    if (fault !== undefined) {
      throw new WireError(fault);
    }
    return value;
  };
  return "get" in codec
    ? fixed({ ...codec, get: (view, at) => check(codec.get(view, at)) })
    : { ...codec, read: (reader) => check(codec.read(reader)) };
}

/** Reads and writes bytes that hold one value and nothing else. */
export function whole<T>({ read, write }: Codec<T>) {
  return {
    encode(value: T): Uint8Array<ArrayBuffer> {
      const writer = new Writer();
      write(writer, value);
      return writer.take();
    },
    decode(bytes: Uint8Array): T {
      const reader = new Reader(bytes);
      const value = read(reader);
      reader.end();
      return value;
    },
  };
}
