/** The items of a frame, all at once. */

import type { Fixed } from "./fixed.ts";

/** Reads and writes all items of a frame. */
export interface Items<I> {
  /** The bytes of an item. */
  readonly size: number;
  /** The bytes of these items. They may share memory with them. */
  encode(items: I): Uint8Array;
  /** Reads items, which may keep the memory of the bytes. These begin a buffer and hold whole items. */
  decode(bytes: Uint8Array<ArrayBuffer>): I;
}

/** Items as an array of values. */
export function itemsOf<T>({ size, get, set }: Fixed<T>): Items<readonly T[]> {
  return {
    size,
    encode(items) {
      const bytes = new Uint8Array(items.length * size);
      const view = new DataView(bytes.buffer);
      for (const [i, item] of items.entries()) {
        set(view, i * size, item);
      }
      return bytes;
    },
    decode(bytes) {
      const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.length);
      return Array.from({ length: bytes.length / size }, (_, i) => get(view, i * size));
    },
  };
}

interface Typed {
  readonly buffer: ArrayBufferLike;
  readonly byteOffset: number;
  readonly byteLength: number;
}

interface TypedArray<A extends Typed> {
  readonly BYTES_PER_ELEMENT: number;
  new (buffer: ArrayBuffer, byteOffset: number, length: number): A;
}

/**
 * Items as a typed array, `numbers` of its elements for each item: `typedItems(Float32Array, 3)`.
 *
 * This copies nothing. It requires a little-endian machine, as WebGL does.
 */
export function typedItems<A extends Typed>(type: TypedArray<A>, numbers = 1): Items<A> {
  const size = numbers * type.BYTES_PER_ELEMENT;
  return {
    size,
    encode(items) {
      if (items.byteLength % size !== 0) {
        throw new RangeError(`${items.byteLength} bytes of items, each of ${size}`);
      }
      return new Uint8Array(items.buffer, items.byteOffset, items.byteLength);
    },
    decode: ({ buffer, byteOffset, byteLength }) =>
      new type(buffer, byteOffset, byteLength / type.BYTES_PER_ELEMENT),
  };
}
