/** Values of a fixed size: numbers, arrays and structs, without padding, in little-endian order. */

import type { Codec, Of } from "./codec.ts";

/** How values lie in memory. */
export interface Layout<T> {
  /** The bytes of each value. */
  readonly size: number;
  get(view: DataView, at: number): T;
  set(view: DataView, at: number, value: T): void;
}

/** A codec whose values all have the same size. */
export interface Fixed<T> extends Codec<T>, Layout<T> {}

/** Makes a codec of a layout, for types that `struct` and `array` cannot describe. */
export function fixed<T>({ size, get, set }: Layout<T>): Fixed<T> {
  const layout = { size, get, set };
  return { ...layout, read: (r) => r.fixed(layout), write: (w, value) => w.fixed(layout, value) };
}

const NUMBERS = {
  u8: fixed<number>({ size: 1, get: (v, at) => v.getUint8(at), set: (v, at, x) => v.setUint8(at, x) }),
  i8: fixed<number>({ size: 1, get: (v, at) => v.getInt8(at), set: (v, at, x) => v.setInt8(at, x) }),
  u16: fixed<number>({
    size: 2,
    get: (v, at) => v.getUint16(at, true),
    set: (v, at, x) => v.setUint16(at, x, true),
  }),
  i16: fixed<number>({
    size: 2,
    get: (v, at) => v.getInt16(at, true),
    set: (v, at, x) => v.setInt16(at, x, true),
  }),
  u32: fixed<number>({
    size: 4,
    get: (v, at) => v.getUint32(at, true),
    set: (v, at, x) => v.setUint32(at, x, true),
  }),
  i32: fixed<number>({
    size: 4,
    get: (v, at) => v.getInt32(at, true),
    set: (v, at, x) => v.setInt32(at, x, true),
  }),
  f32: fixed<number>({
    size: 4,
    get: (v, at) => v.getFloat32(at, true),
    set: (v, at, x) => v.setFloat32(at, x, true),
  }),
  f64: fixed<number>({
    size: 8,
    get: (v, at) => v.getFloat64(at, true),
    set: (v, at, x) => v.setFloat64(at, x, true),
  }),
  u64: fixed<bigint>({
    size: 8,
    get: (v, at) => v.getBigUint64(at, true),
    set: (v, at, x) => v.setBigUint64(at, x, true),
  }),
  i64: fixed<bigint>({
    size: 8,
    get: (v, at) => v.getBigInt64(at, true),
    set: (v, at, x) => v.setBigInt64(at, x, true),
  }),
  u128: fixed<bigint>({
    size: 16,
    get: (v, at) => v.getBigUint64(at, true) | (v.getBigUint64(at + 8, true) << 64n),
    set(v, at, x) {
      v.setBigUint64(at, x, true);
      v.setBigUint64(at + 8, x >> 64n, true);
    },
  }),
} as const;

/** A number by Rust's name. Integers of 64 bits and more are bigints. */
export type NumberType = keyof typeof NUMBERS;

/** A number by its name, or another value of a fixed size. */
export type FieldType = NumberType | Fixed<unknown>;

/** The values of a `FieldType`. */
export type ValueOf<F> = F extends NumberType ? Of<(typeof NUMBERS)[F]> : Of<F>;

/** A number of fixed width. */
export function number<N extends NumberType>(type: N): (typeof NUMBERS)[N] {
  return NUMBERS[type];
}

/** A value without content, as Rust's `()`. */
export const nothing: Fixed<undefined> = fixed({ size: 0, get: () => undefined, set: () => {} });

/** A tuple of `N` values; an array, if those are more than 16 or not known. */
type Tuple<T, N extends number, All extends readonly T[] = readonly []> = All["length"] extends N
  ? number extends N
    ? readonly T[]
    : All
  : All["length"] extends 16
    ? readonly T[]
    : Tuple<T, N, readonly [...All, T]>;

/** As many values as `length` says, as Rust's `[T; length]`. */
export function array<F extends FieldType, N extends number>(
  type: F,
  length: N,
): Fixed<Tuple<ValueOf<F>, N>> {
  const { size, get, set } = fixedOf(type);
  return fixed<never>({
    size: length * size,
    get: (view, at) => Array.from({ length }, (_, i) => get(view, at + i * size)) as never,
    set(view, at, values: readonly unknown[]) {
      if (values.length !== length) {
        throw new RangeError(`an array of ${values.length} values: it has ${length}`);
      }
      for (const [i, value] of values.entries()) {
        set(view, at + i * size, value);
      }
    },
  });
}

/** An object with these fields, one behind the other: `struct({ x: "f32", y: "f32", id: "u32" })`. */
export function struct<F extends Readonly<Record<string, FieldType>>>(
  fields: F,
): Fixed<{ readonly [Name in keyof F]: ValueOf<F[Name]> }> {
  let size = 0;
  const all = Object.entries(fields).map(([name, type]) => {
    const field = { name, at: size, ...fixedOf(type) };
    size += field.size;
    return field;
  });
  return fixed<never>({
    size,
    get(view, at) {
      const value: Record<string, unknown> = {};
      for (const field of all) {
        value[field.name] = field.get(view, at + field.at);
      }
      return value as never;
    },
    set(view, at, value: Readonly<Record<string, unknown>>) {
      for (const field of all) {
        field.set(view, at + field.at, value[field.name]);
      }
    },
  });
}

function fixedOf(type: FieldType): Fixed<unknown> {
  return typeof type === "string" ? (NUMBERS[type] as Fixed<unknown>) : type;
}
