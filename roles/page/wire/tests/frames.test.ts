/** Frames are assembled, and violations of their order, count or hash are detected. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { WireError, Writer } from "../src/bytes.ts";
import { number } from "../src/fixed.ts";
import { type BatchDecoder, type Frame, FrameAssembler, loadHasher } from "../src/frames.ts";
import { typedItems } from "../src/items.ts";
import { Kind, type Message } from "../src/messages.ts";
import { endOf, range } from "./support.ts";

const hasher = await loadHasher();

const begin = (number: number): Message => {
  return { kind: Kind.begin, payload: new Writer().u32(number).u8(number).take() };
};

const batch = (...items: number[]): Message => {
  return { kind: Kind.batch, payload: new Uint8Array(Uint32Array.from(items).buffer) };
};

const coded = (...bytes: number[]): Message => ({ kind: Kind.codedBatch, payload: Uint8Array.from(bytes) });

/** The end of a frame of these items. */
const end = (number: number, items: readonly number[]): Message => {
  return { kind: Kind.end, payload: endOf(number, items) };
};

type Items = Uint32Array<ArrayBuffer>;

const PLAIN = { header: number("u8"), items: typedItems(Uint32Array) };

const coding = (decoder: BatchDecoder<Items>) => ({ ...PLAIN, decoder: () => decoder });

function takeAll(
  assembler: FrameAssembler<number, Items>,
  messages: readonly Message[],
): Frame<number, Items>[] {
  return messages.map((message) => assembler.take(message)).filter((outcome) => outcome !== undefined);
}

/** Reads each byte as an item, and records its calls. */
class Bytes implements BatchDecoder<Items> {
  told: unknown[] = [];

  decode(bytes: Uint8Array, frame: number, room: number): Items {
    this.told.push([frame, room]);
    return Uint32Array.from(bytes);
  }

  complete(frame: number, items: Items): void {
    this.told.push([frame, [...items]]);
  }
}

test("plain and coded batches make one frame, and the decoder is told of it", () => {
  const decoder = new Bytes();
  const assembler = new FrameAssembler(hasher, coding(decoder), 9);
  const items = [5, 3, 1, 2, 9, 0xffff_ffff];
  const outcomes = takeAll(assembler, [
    begin(4),
    batch(5, 3),
    coded(1, 2),
    batch(9, 0xffff_ffff),
    end(4, items),
  ]);
  const frame = { number: 4, header: 4, items: Uint32Array.from(items) };
  assert.deepEqual(outcomes, [frame]);
  assert.deepEqual(decoder.told, [
    [4, 7],
    [4, items],
  ]);
});

test("frames follow each other, with gaps and without items", () => {
  const assembler = new FrameAssembler(hasher, PLAIN, 100_000);
  const many = range(0, 40_000);
  const batches = [0, 1, 2, 3].map((part) => batch(...many.slice(10_000 * part, 10_000 * (part + 1))));
  const messages = [begin(0), end(0, []), begin(7), ...batches, end(7, many), begin(8), end(8, [])];
  const frames = takeAll(assembler, messages).map(({ items }) => [...items]);
  assert.deepEqual(frames, [[], many, []]);
});

test("the memory of a frame doubles as items come, up to the most that it may have", () => {
  const held = range(1, 10).map((count) => {
    const items = range(0, count);
    const messages = [begin(0), ...items.map((item) => batch(item)), end(0, items)];
    const [frame] = takeAll(new FrameAssembler(hasher, PLAIN, 9), messages);
    return frame?.items.buffer.byteLength;
  });
  assert.deepEqual(held, [4, 8, 16, 16, 32, 32, 32, 32, 36]);
});

test("a frame of which items are missing is not complete, and no reference", () => {
  const decoder = new Bytes();
  const assembler = new FrameAssembler(hasher, coding(decoder), 9);
  const outcomes = takeAll(assembler, [begin(1), batch(1), end(1, [1, 2]), begin(2), batch(3), end(2, [3])]);
  assert.deepEqual(
    outcomes.map(({ number }) => number),
    [2],
  );
  assert.deepEqual(decoder.told, [[2, [3]]]);
});

test("a peer that breaks the order or lies is found", () => {
  const wrongHash = { kind: Kind.end, payload: new Writer().u32(1).u32(1).u64(7n).take() };
  const fewer = new Writer()
    .u32(1)
    .u32(1)
    .bytes(endOf(1, [1, 2]).subarray(8))
    .take();
  const faults: [string, Message[], RegExp][] = [
    ["begin within a frame", [begin(1), begin(2)], /frame 2 began before the end of frame 1/],
    ["the same number again", [begin(1), end(1, []), begin(1)], /frame 1 began after frame 1/],
    ["a smaller number", [begin(3), end(3, []), begin(2)], /frame 2 began after frame 3/],
    ["items before begin", [batch(1)], /outside of a frame/],
    ["changes before begin", [coded(1)], /outside of a frame/],
    ["items after the end", [begin(1), end(1, []), batch(1)], /outside of a frame/],
    ["an end before begin", [end(1, [])], /frame 1 ended, and frame none was open/],
    ["the end of another", [begin(1), end(2, [])], /frame 2 ended, and frame 1 was open/],
    ["more than announced", [begin(1), batch(1, 2), end(1, [1])], /not those that its end announces/],
    ["a count below the hash", [begin(1), batch(1, 2), { kind: Kind.end, payload: fewer }], /not those that/],
    ["others than announced", [begin(1), batch(1), end(1, [2])], /not those that its end announces/],
    ["another order", [begin(1), batch(1, 2), end(1, [2, 1])], /not those that its end announces/],
    ["another hash", [begin(1), batch(1), wrongHash], /not those that its end announces/],
    ["a part of an item", [begin(1), { kind: Kind.batch, payload: new Uint8Array(6) }], /part of an item/],
    [
      "what does not belong there",
      [{ kind: Kind.block, payload: new Uint8Array(6) }],
      /not of the frames lane/,
    ],
    ["more than a frame can have", [begin(1), batch(1, 2, 3), batch(4)], /more than 3 items/],
    ["more by changes", [begin(1), batch(1, 2, 3), coded(4)], /more than 3 items/],
  ];
  for (const [name, messages, text] of faults) {
    const take = () => takeAll(new FrameAssembler(hasher, coding(new Bytes()), 3), messages);
    assert.throws(take, (error) => error instanceof WireError && text.test(error.message), name);
  }
});

test("changes that were not asked for are refused", () => {
  const assembler = new FrameAssembler(hasher, PLAIN, 3);
  assert.throws(
    () => takeAll(assembler, [begin(1), coded(1)]),
    new WireError("a batch came coded, and was not asked for so"),
  );
});
