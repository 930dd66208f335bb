/**
 * The content of the bulk lane for a display without the scene: blocks of items, one behind the other.
 *
 * A display sends its needs and holdings. A culler sends geometry and messages about it.
 */

import {
  bool,
  bytes,
  type Codec,
  count,
  type Fields,
  MOST_BLOCK,
  type Of,
  Reader,
  tagged,
  u32,
  Writer,
  whole,
} from "trimaran-transport";
import { NUMBERS, partNumbers } from "./numbers.ts";

/** A display's messages to a culler, in the order of their numbers. Frame numbers are the display's. */
const DISPLAY_ITEM = tagged("item", {
  begin: { coarserFirst: bool, ahead: count },
  end: {},
  holds: { drawables: NUMBERS, geometries: NUMBERS },
  lacks: { frame: u32, taken: count, drawables: NUMBERS },
  dropped: { geometries: NUMBERS },
  taken: { bytes: count },
  shown: { frame: u32 },
});

export type DisplayItem = Of<typeof DISPLAY_ITEM>;

/** A part of a piece of geometry. */
const PIECE_PART = {
  /** The number of the piece. */
  number: u32,
  /** The bytes of the whole piece. */
  length: u32,
  /** The part's offset in it. */
  offset: u32,
  part: bytes,
};

export type PiecePart = Fields<typeof PIECE_PART>;

/** A culler's messages to a display, in the order of their numbers. */
const CULLER_ITEM = tagged("item", {
  entries: { packed: bytes },
  geometry: PIECE_PART,
  "stand-in": { id: u32, pieces: u32, drawables: NUMBERS },
  ahead: { geometries: NUMBERS },
});

export type CullerItem = Of<typeof CULLER_ITEM>;

/** Messages of a display that has these already. */
export function holds(drawables: Uint32Array, geometries: Uint32Array): DisplayItem[] {
  const none = new Uint32Array(0);
  return [
    ...partNumbers(drawables).map((part) => ({ item: "holds", drawables: part, geometries: none }) as const),
    ...partNumbers(geometries).map((part) => ({ item: "holds", drawables: none, geometries: part }) as const),
  ];
}

/** Messages of a display that lacks these drawables of a frame, and has taken this many bytes. */
export function lacks(frame: number, taken: number, drawables: Uint32Array): DisplayItem[] {
  return partNumbers(drawables).map((part) => ({ item: "lacks", frame, taken, drawables: part }));
}

/** Messages of a display that has evicted these pieces. */
export function dropped(geometries: Uint32Array): DisplayItem[] {
  return partNumbers(geometries).map((part) => ({ item: "dropped", geometries: part }));
}

/** The payloads of the fewest blocks that hold a display's items, in order. */
export function packBlocks(items: Iterable<DisplayItem>): Uint8Array<ArrayBuffer>[] {
  const blocks: Uint8Array<ArrayBuffer>[] = [];
  let block = new Writer();
  for (const item of items) {
    const bytes = encodeDisplayItem(item);
    if (bytes.length > MOST_BLOCK) {
      throw new RangeError(`an item of ${bytes.length} bytes: ${MOST_BLOCK} fit into a block`);
    }
    if (block.length + bytes.length > MOST_BLOCK) {
      blocks.push(block.take());
      block = new Writer();
    }
    block.bytes(bytes);
  }
  return block.length === 0 ? blocks : [...blocks, block.take()];
}

/** The items of a block of a culler. */
export function decodeCullerBlock(block: Uint8Array): CullerItem[] {
  return readItems(block, CULLER_ITEM);
}

/** The items of a block of a display. */
export function decodeDisplayBlock(block: Uint8Array): DisplayItem[] {
  return readItems(block, DISPLAY_ITEM);
}

export const { encode: encodeDisplayItem } = whole(DISPLAY_ITEM);

function readItems<T>(block: Uint8Array, { read }: Codec<T>): T[] {
  const reader = new Reader(block);
  const items: T[] = [];
  while (!reader.isAtEnd) {
    items.push(read(reader));
  }
  return items;
}
