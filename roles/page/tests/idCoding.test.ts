/** Ids coded as changes are decoded, and any invalid bytes are refused. */

import assert from "node:assert/strict";
import { test } from "node:test";
import { WireError, Writer } from "trimaran-transport";
import { faultOfIds, IdDecoder } from "../src/proto/idCoding.ts";
import { randomOf, range } from "../wire/tests/support.ts";
import { encodeIds } from "./idEncoder.ts";

const ROOM = 20_000;

/** A decoder that holds one frame, of number 5. */
function holding(ids: readonly number[]): IdDecoder {
  const decoder = new IdDecoder();
  decoder.complete(5, Uint32Array.from(ids));
  return decoder;
}

/** Ascending ids: some of `near`, and others among and above these. */
function someIds(random: (below: number) => number, near: readonly number[]): number[] {
  const kept = near.filter(() => random(8) > 0);
  const put = range(0, random(20)).map(() => (random(2) === 0 ? random(400) : random(2 ** 32)));
  const edges = random(4) === 0 ? [0, 0xffff_ffff] : [];
  return [...new Set([...kept, ...put, ...edges])].sort((a, b) => a - b);
}

const varints = (...numbers: number[]) =>
  numbers.reduce((writer, number) => writer.varint(number), new Writer()).take();

test("whatever ids rise read back from changes, over a reference and over nothing", () => {
  const random = randomOf(2);
  for (let round = 0; round < 2000; round += 1) {
    const before = someIds(random, range(random(100), 200));
    const ids = someIds(random, before);
    if (ids.length > 0) {
      const from = random(ids.length);
      const batch = ids.slice(from, from + 1 + random(ids.length));
      const decoder = holding(before);
      assert.deepEqual([...decoder.decode(encodeIds(batch, 3, before), 8, ROOM)], batch);
      assert.deepEqual([...decoder.decode(encodeIds(batch, 0, []), 8, ROOM)], batch);
    }
  }
});

test("bytes that are cut short or damaged give rising ids or a WireError", () => {
  const random = randomOf(3);
  let refused = 0;
  for (let round = 0; round < 3000; round += 1) {
    const before = someIds(random, range(random(100), 200));
    const bytes = encodeIds([0, ...someIds(random, before).filter((id) => id > 0)], 3, before);
    const length = random(3) === 0 ? random(bytes.length) : bytes.length;
    const damaged = bytes.slice(0, length);
    for (let changes = random(4); changes > 0 && length > 0; changes -= 1) {
      damaged[random(length)] = random(256);
    }
    try {
      const ids = holding(before).decode(damaged, 8, ROOM);
      assert(ids.length > 0 && ids.length <= 16_384);
      assert(ids.every((id, at) => at === 0 || id > (ids[at - 1] ?? id)));
    } catch (error) {
      assert(error instanceof WireError, String(error));
      refused += 1;
    }
  }
  assert(refused > 500, `${refused} were refused`);
});

test("each fault is named", () => {
  const faults: [string, Uint8Array, RegExp][] = [
    ["no bytes", varints(), /cut short/],
    ["a frame that is not held", varints(2, 0, 0), /refer to a frame 2 before frame 8/],
    ["a frame before the first", varints(9, 0, 0), /refer to a frame 9 before frame 8/],
    ["a place beyond the reference", varints(3, 4, 0), /reaches beyond the 3 ids/],
    ["more kept than there are", varints(3, 1, 4 * 3 + 2, 0), /reaches beyond the 3 ids/],
    ["more skipped than there are", varints(3, 1, 2, 3), /reaches beyond the 3 ids/],
    ["something kept of nothing", varints(0, 4), /reaches beyond the 0 ids/],
    ["no id", varints(3, 0, 0), /no id/],
    ["no run", varints(3, 0), /no id/],
    ["a run without its number", varints(3, 0, 4 + 3), /cut short/],
    ["a gap that is missing", varints(3, 0, 3, 2, 1), /cut short/],
    ["ids beyond 32 bits", varints(0, 3, 2, 0xffff_ffff, 0), /do not rise/],
    ["a put that passes what is kept next", varints(3, 0, 1, 10, 4), /do not rise/],
    ["many put and few there", varints(0, 3, 0xffff_ffff, 1, 1), /cut short/],
    ["a number above 32 bits", new Writer().varint(2 ** 32).take(), /above 32 bits/],
  ];
  for (const [name, bytes, text] of faults) {
    const decode = () => holding([1, 5, 9]).decode(bytes, 8, ROOM);
    assert.throws(decode, (error) => error instanceof WireError && text.test(error.message), name);
  }
});

test("a run that skips nothing changes nothing for what is put next", () => {
  assert.deepEqual([...holding([1, 5, 9]).decode(varints(3, 1, 2, 0, 1, 1), 8, ROOM)], [3]);
});

test("a batch and a frame have no more ids than they may, and the least that they may", () => {
  const held = range(0, 20_000);
  const kept = (count: number) => varints(3, 0, 4 * count + 2, 0);
  assert.equal(holding(held).decode(kept(16_384), 8, 16_384).length, 16_384);
  assert.throws(() => holding(held).decode(kept(16_385), 8, ROOM), /more than 16384 ids/);
  assert.throws(() => holding(held).decode(kept(16_384), 8, 16_383), /16383 were left/);
  const put = (count: number) => varints(0, 3, count, ...range(0, count).map(() => 0));
  assert.equal(holding([]).decode(put(16_384), 8, ROOM).length, 16_384);
  assert.throws(() => holding([]).decode(put(16_385), 8, ROOM), /more than 16384 ids/);
  assert.throws(() => holding([]).decode(put(3), 8, 2), /2 were left/);
});

test("the last eight complete frames are held, in order of their ids, each once", () => {
  const decoder = new IdDecoder();
  for (const frame of range(0, 10)) {
    const twice = [frame, frame];
    decoder.complete(
      frame,
      Uint32Array.from(frame % 2 === 0 ? [frame + 5, ...twice] : [...twice, frame + 5]),
    );
  }
  const keepTwo = (back: number) => varints(back, 0, 4 * 2 + 2, 0);
  assert.deepEqual([...decoder.decode(keepTwo(8), 10, ROOM)], [2, 7]);
  assert.deepEqual([...decoder.decode(keepTwo(1), 10, ROOM)], [9, 14]);
  assert.throws(() => decoder.decode(keepTwo(9), 10, ROOM), /not held complete/);
});

test("a frame of more than 262,144 ids is not held", () => {
  const decoder = new IdDecoder();
  const ids = Uint32Array.from(range(0, 262_145));
  decoder.complete(1, ids);
  assert.throws(() => decoder.decode(varints(1, 0, 4 + 2, 0), 2, ROOM), /not held complete/);
  decoder.complete(2, ids.subarray(1));
  assert.deepEqual([...decoder.decode(varints(1, 262_143, 4 + 2, 0), 3, ROOM)], [262_144]);
});

test("what is held does not change with whom the frame belongs to", () => {
  const ids = Uint32Array.of(1, 2);
  const decoder = new IdDecoder();
  decoder.complete(1, ids);
  ids.fill(9);
  assert.deepEqual([...decoder.decode(varints(1, 0, 4 * 2 + 2, 0), 2, ROOM)], [1, 2]);
});

test("ids that the scene does not have, or that come twice, are found", () => {
  assert.equal(faultOfIds(Uint32Array.of(), 0), undefined);
  const ids = Uint32Array.of(3, 0, 4);
  assert.equal(faultOfIds(ids, 5), undefined);
  assert.deepEqual([...ids], [3, 0, 4], "they stay in their order");
  assert.equal(faultOfIds(Uint32Array.of(3, 5, 4), 5), "drawable 5 is not in the scene, which has 5");
  assert.equal(faultOfIds(Uint32Array.of(5, 3), 5), "drawable 5 is not in the scene, which has 5");
  assert.equal(faultOfIds(Uint32Array.of(3, 0, 3), 5), "drawable 3 comes twice in a frame");
  assert.equal(faultOfIds(Uint32Array.of(0, 0), 5), "drawable 0 comes twice in a frame");
});
