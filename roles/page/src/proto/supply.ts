/**
 * The content of the bulk lane for a display without the scene: blocks of items, one behind the other.
 *
 * A display sends its needs and holdings. A culler sends geometry and messages about it.
 */

import { Reader, Writer } from "../wire/bytes.ts";
import { MOST_BLOCK } from "../wire/messages.ts";
import { partNumbers, readNumbers, writeNumbers } from "./numbers.ts";

/** A display's messages to a culler. Frame numbers are the display's. */
export type DisplayItem =
  | { readonly item: "begin"; readonly coarserFirst: boolean; readonly ahead: number }
  | { readonly item: "end" }
  | { readonly item: "holds"; readonly drawables: Uint32Array; readonly geometries: Uint32Array }
  | {
      readonly item: "lacks";
      readonly frame: number;
      readonly taken: number;
      readonly drawables: Uint32Array;
    }
  | { readonly item: "dropped"; readonly geometries: Uint32Array }
  | { readonly item: "taken"; readonly bytes: number }
  | { readonly item: "shown"; readonly frame: number };

/** A culler's messages to a display. */
export type CullerItem =
  | { readonly item: "entries"; readonly packed: Uint8Array }
  | ({ readonly item: "geometry" } & PiecePart)
  | { readonly item: "stand-in"; readonly id: number; readonly drawables: Uint32Array }
  | { readonly item: "ahead"; readonly geometries: Uint32Array };

/** A part of a piece of geometry. */
export interface PiecePart {
  /** The number of the piece. */
  readonly number: number;
  /** The bytes of the whole piece. */
  readonly length: number;
  /** The part's offset in it. */
  readonly offset: number;
  readonly part: Uint8Array;
}

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
  return readItems(block, readCullerItem);
}

/** The items of a block of a display. */
export function decodeDisplayBlock(block: Uint8Array): DisplayItem[] {
  return readItems(block, readDisplayItem);
}

export function encodeDisplayItem(item: DisplayItem): Uint8Array<ArrayBuffer> {
  const writer = new Writer().variant(DISPLAY_ITEMS, item.item);
  switch (item.item) {
    case "begin":
      writer.bool(item.coarserFirst).varint(item.ahead);
      break;
    case "end":
      break;
    case "holds":
      writeNumbers(writer, item.drawables);
      writeNumbers(writer, item.geometries);
      break;
    case "lacks":
      writer.varint(item.frame).varint(item.taken);
      writeNumbers(writer, item.drawables);
      break;
    case "dropped":
      writeNumbers(writer, item.geometries);
      break;
    case "taken":
      writer.varint(item.bytes);
      break;
    case "shown":
      writer.varint(item.frame);
      break;
  }
  return writer.take();
}

function readItems<T>(block: Uint8Array, read: (reader: Reader) => T): T[] {
  const reader = new Reader(block);
  const items: T[] = [];
  while (!reader.isAtEnd) {
    items.push(read(reader));
  }
  return items;
}

function readCullerItem(reader: Reader): CullerItem {
  const item = reader.variant(CULLER_ITEMS);
  switch (item) {
    case "entries":
      return { item, packed: reader.byteString() };
    case "geometry": {
      const [number, length, offset] = [reader.varint32(), reader.varint32(), reader.varint32()];
      return { item, number, length, offset, part: reader.byteString() };
    }
    case "stand-in":
      return { item, id: reader.varint32(), drawables: readNumbers(reader) };
    case "ahead":
      return { item, geometries: readNumbers(reader) };
  }
}

function readDisplayItem(reader: Reader): DisplayItem {
  const item = reader.variant(DISPLAY_ITEMS);
  switch (item) {
    case "begin":
      return { item, coarserFirst: reader.bool(), ahead: reader.varintCount() };
    case "end":
      return { item };
    case "holds":
      return { item, drawables: readNumbers(reader), geometries: readNumbers(reader) };
    case "lacks": {
      const [frame, taken] = [reader.varint32(), reader.varintCount()];
      return { item, frame, taken, drawables: readNumbers(reader) };
    }
    case "dropped":
      return { item, geometries: readNumbers(reader) };
    case "taken":
      return { item, bytes: reader.varintCount() };
    case "shown":
      return { item, frame: reader.varint32() };
  }
}

/** The items of each side, in the order of their numbers. */
const DISPLAY_ITEMS = ["begin", "end", "holds", "lacks", "dropped", "taken", "shown"] as const;
const CULLER_ITEMS = ["entries", "geometry", "stand-in", "ahead"] as const;
