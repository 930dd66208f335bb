/** Items of blocks, lists of numbers, and splitting these. */

import assert from "node:assert/strict";
import { test } from "node:test";
import { Reader, WireError, Writer } from "trimaran-transport";
import { NUMBERS, numberList, partNumbers } from "../src/proto/numbers.ts";
import {
  type DisplayItem,
  decodeCullerBlock,
  decodeDisplayBlock,
  dropped,
  encodeDisplayItem,
  holds,
  lacks,
  packBlocks,
} from "../src/proto/supply.ts";
import { fromHex, randomOf, range, toHex } from "../wire/tests/support.ts";

const written = (numbers: Iterable<number>) => {
  const writer = new Writer();
  NUMBERS.write(writer, numberList(numbers));
  return writer.take();
};

/** Numbers so far apart that each takes the most bytes. */
const far = (count: number) => numberList(range(0, count).map((at) => 0xffff_ffff - at * 1_400_000));

test("lists of numbers rise, hold each once, and read back", () => {
  assert.deepEqual([...numberList([5, 1, 5, 0xffff_ffff])], [1, 5, 0xffff_ffff]);
  assert.equal(toHex(written([5, 4, 134])), "04 04 00 80 01");
  const random = randomOf(4);
  for (let round = 0; round < 500; round += 1) {
    const below = 2 ** (1 + random(32));
    const list = numberList(range(0, random(50)).map(() => random(below)));
    const writer = new Writer();
    NUMBERS.write(writer, list);
    const reader = new Reader(writer.take());
    assert.deepEqual(NUMBERS.read(reader), list);
    assert(reader.isAtEnd);
  }
});

test("numbers beyond 32 bits are refused", () => {
  const read = (hex: string) => NUMBERS.read(new Reader(fromHex(hex)));
  assert.deepEqual([...read("05 ff ff ff ff 0f")], [0xffff_ffff]);
  assert.throws(() => read("06 ff ff ff ff 0f 00"), new WireError("the numbers of a list go beyond 32 bits"));
  assert.throws(() => read("01 80"), WireError);
  assert.throws(() => read("05 80 80 80 80 10"), WireError);
});

test("a long list is parted, and 3,000 numbers fit into a block however large they are", () => {
  assert.deepEqual(partNumbers(new Uint32Array(0)), []);
  const list = numberList(range(0, 7001));
  assert.deepEqual(
    partNumbers(list).map((part) => part.length),
    [3000, 3000, 1001],
  );
  assert.deepEqual(
    partNumbers(list).flatMap((part) => [...part]),
    range(0, 7001),
  );
  const largest = far(3000);
  assert.equal(largest.length, 3000);
  assert.equal(packBlocks(lacks(0xffff_ffff, Number.MAX_SAFE_INTEGER, largest)).length, 1);
  assert.equal(packBlocks(holds(largest, new Uint32Array(0))).length, 1);
});

test("blocks hold the items in order, each whole, and are as few as can be", () => {
  const items: DisplayItem[] = [
    ...holds(far(3000), far(2)),
    { item: "begin", coarserFirst: true, ahead: 1 },
    ...lacks(3, 4, numberList(range(0, 4000))),
    ...dropped(far(3000)),
    { item: "end" },
  ];
  const blocks = packBlocks(items);
  assert.deepEqual(blocks.flatMap(decodeDisplayBlock), items);
  const lengths = blocks.map((block) => block.length);
  assert(lengths.every((length) => length > 0 && length <= 16_384));
  for (const [at, block] of blocks.slice(1).entries()) {
    const [first] = decodeDisplayBlock(block);
    assert(first !== undefined && (lengths[at] ?? 0) + encodeDisplayItem(first).length > 16_384);
  }
  assert.deepEqual(packBlocks([]), []);
});

test("a block of exactly 16,384 bytes is one", () => {
  const packed = (count: number) =>
    packBlocks([{ item: "dropped", geometries: numberList(range(0, count)) }]).map((block) => block.length);
  assert.deepEqual(packed(16_381), [16_384]);
  const tooLong = new RangeError("an item of 16385 bytes: 16384 fit into a block");
  assert.throws(() => packed(16_382), tooLong);
  const taken: DisplayItem = { item: "taken", bytes: 0 };
  const full = range(0, 8192).map(() => taken);
  assert.deepEqual(
    packBlocks(full).map((block) => block.length),
    [16_384],
  );
  assert.deepEqual(
    packBlocks([...full, taken]).map((block) => block.length),
    [16_384, 2],
  );
});

test("each item of a display reads back", () => {
  const items: DisplayItem[] = [
    { item: "begin", coarserFirst: false, ahead: Number.MAX_SAFE_INTEGER },
    { item: "end" },
    { item: "holds", drawables: numberList([1]), geometries: numberList([]) },
    { item: "lacks", frame: 1, taken: 2, drawables: numberList([3]) },
    { item: "dropped", geometries: numberList([4]) },
    { item: "taken", bytes: 5 },
    { item: "shown", frame: 0xffff_ffff },
  ];
  for (const [number, item] of items.entries()) {
    assert.equal(encodeDisplayItem(item)[0], number);
    assert.deepEqual(decodeDisplayBlock(encodeDisplayItem(item)), [item]);
  }
});

test("items of a culler stand one behind the other", () => {
  const block = fromHex("00 02 aa bb  03 01 05  01 08 04 02 01 cc  02 09 03 00");
  assert.deepEqual(decodeCullerBlock(block), [
    { item: "entries", packed: Uint8Array.of(0xaa, 0xbb) },
    { item: "ahead", geometries: numberList([5]) },
    { item: "geometry", number: 8, length: 4, offset: 2, part: Uint8Array.of(0xcc) },
    { item: "stand-in", id: 9, pieces: 3, drawables: numberList([]) },
  ]);
  assert.deepEqual(decodeCullerBlock(new Uint8Array(0)), []);
  for (const length of range(1, block.length)) {
    const isBetweenItems = [4, 7, 13].includes(length);
    const read = () => decodeCullerBlock(block.subarray(0, length));
    isBetweenItems ? read() : assert.throws(read, WireError, `${length} bytes`);
  }
  assert.throws(() => decodeCullerBlock(fromHex("04")), WireError);
  assert.throws(() => decodeDisplayBlock(fromHex("07")), WireError);
});
