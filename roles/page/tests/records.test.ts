/** Records of drawables unpack, and invalid ones are refused. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { type DrawableRecord, Records, unpackRecords } from "../src/proto/records.ts";
import { unzstd } from "../src/proto/zstd.ts";
import { WireError, Writer } from "../src/wire/bytes.ts";
import { packRecords, rawFrame } from "./packing.ts";
import { fromHex, range } from "./support.ts";

const OUTLINE = { hash: 1n, nodes: 400, drawables: 600, geometries: 250, objects: 100 };

/** A record like many in a scene: a few numbers differ from those of the one before. */
function record(id: number, change: Partial<DrawableRecord> = {}): DrawableRecord {
  return {
    worldMin: [id, 2, -3],
    worldMax: [id + 1, 2, 3.5],
    origin: [id + 0.5, 1e6, 0],
    linear: [1, 0, 0, 0, 1, 0, 0, 0, 1],
    id,
    node: id >>> 1,
    geometry: 249 - id,
    triangles: 12,
    sides: id & 1,
    object: 7,
    objects: 1,
    ...change,
  };
}

/** 40 records, packed by zstd at level 3, with a checksum. */
const PACKED = `
28 00 28 b5 2f fd 64 40 14 9d 08 00 e4 08 00 00 80 80 40 00 c0 08 18 22 28 2e 32 35 38 3b 3e 40 42 43
45 46 48 49 4b 4c 4e 4f 50 51 52 52 53 54 55 55 56 57 58 58 59 5a 5b 5b 5c 5d 00 40 00 40 00 08 c0 00
f0 10 1c 24 2a 30 33 36 39 3c 3f 41 42 44 45 47 48 4a 4b 4d 4e 50 50 51 52 53 53 54 55 56 56 57 58 59
59 5a 5b 5c 5c 5d 3f 40 0c 80 c0 40 a0 60 20 e0 e0 0c 1a 23 29 2f 3f 80 84 2e 41 80 3f 80 3f 80 3f 00
03 00 01 02 00 f9 fd 00 ff 0c 0c 0c 00 00 00 01 00 07 01 01 39 20 20 83 4b 92 36 07 21 58 28 e8 c1 14
0a 99 4b 6f 96 32 55 99 67 90 4d 07 e4 d2 03 bd a2 a0 0f 8e 7f 86 86 9e 02 7d b0 4a d9 a7 51 0a e5 75
53 a3 a1 40 79 96 9c 4f b5 38 43 79 94 dc 41 59 1b 15 94 47 c9 5c 0a 94 47 bc 14 1b 5c 0e 7c 99 43 11
16 cf 43 19 ae 64 f8 50 53 06 e8 13 40 c0 36 ea a6 20 7a c5 9c 06 e3 4d 27 84 2b 00 4a 9d 25 a3 14 36
ea 28 19 85 aa 48 fc 94 ef d9 8d 39 29 d8 06 09 d4 37 ff
`;

test("records read back, whatever their order", () => {
  for (const ids of [[], [5], [5, 6, 9], [9, 0, 6], range(0, 249)]) {
    const records = ids.map((id) => record(id));
    assert.deepEqual(unpackRecords(packRecords(records)), records);
  }
  assert.equal(unpackRecords(packRecords(range(0, 256).map(() => record(3)))).length, 256);
  const modelledSeeThrough = record(5, { objects: 2 ** 31 + 3 });
  assert.deepEqual(unpackRecords(packRecords([modelledSeeThrough])), [record(5, { objects: 3 })]);
});

test("what zstd has packed reads back", () => {
  assert.deepEqual(
    unpackRecords(fromHex(PACKED)),
    range(0, 40).map((id) => record(3 * id)),
  );
});

test("more than 256 records, and another length than theirs, are refused", () => {
  const tooMany = packRecords(range(0, 257).map(() => record(3)));
  assert.throws(
    () => unpackRecords(tooMany),
    new WireError("257 records are packed together: 256 is the most"),
  );
  const packed = packRecords([record(1), record(2)]);
  for (const count of [0, 1, 3]) {
    assert.throws(() => unpackRecords(Uint8Array.of(count, 0, ...packed.subarray(2))), WireError);
  }
  for (const length of range(0, packed.length)) {
    assert.throws(() => unpackRecords(packed.subarray(0, length)), WireError, `${length} bytes`);
  }
});

test("damaged zstd is refused or is as long as it must be", () => {
  const packed = fromHex(PACKED);
  let refused = 0;
  for (const at of range(2, packed.length)) {
    for (const change of [1, 0x80, 0xff]) {
      const damaged = packed.slice();
      damaged[at] = (damaged[at] ?? 0) ^ change;
      try {
        assert.equal(unpackRecords(damaged).length, 40);
      } catch (error) {
        assert(error instanceof WireError, String(error));
        refused += 1;
      }
    }
  }
  assert(refused > 50, `${refused} were refused`);
});

test("a frame of zstd is one, claims its length if any, and nothing unreasonable", () => {
  const content = Uint8Array.from(range(0, 200));
  assert.deepEqual(unzstd(rawFrame(content), 200), content);
  // Two blocks, the second of one repeated byte, with a window and no length.
  const start = new Writer()
    .u32(0xfd2fb528)
    .u8(0)
    .u8(0x38)
    .u24(2 << 3)
    .bytes(Uint8Array.of(1, 2));
  const repeated = (times: number) =>
    new Writer()
      .bytes(start.take())
      .u24((times << 3) | 2 | 1)
      .u8(9)
      .take();
  assert.deepEqual(unzstd(repeated(3), 5), Uint8Array.of(1, 2, 9, 9, 9));
  const head = (...bytes: number[]) => new Writer().u32(0xfd2fb528).bytes(Uint8Array.from(bytes));
  const faults: [string, Uint8Array, RegExp][] = [
    ["no magic", fromHex("00 00 00 00 00"), /no frame of zstd/],
    ["another length claimed", rawFrame(content.subarray(1)), /claims to hold 199 bytes, not 200/],
    [
      "a length of 2^63",
      head(0xe0)
        .u64(1n << 63n)
        .u24(1)
        .take(),
      /claims to hold/,
    ],
    ["a window of gigabytes", head(0, 0xa0).u24(1).take(), /window/],
    ["a dictionary", head(0x21, 200, 7).u24(1).take(), /dictionary/],
    ["a reserved bit", head(0x28, 200).u24(1).take(), /version to come/],
    ["too short", repeated(197), /holds 199 bytes, not 200/],
    ["too long", repeated(199), /more than 200/],
    ["a block of two megabytes", repeated(0x1f_ffff), /more than 200/],
    ["something behind it", Uint8Array.of(...rawFrame(content), 0), /1 bytes too many/],
    [
      "a block that is no kind",
      head(0x20, 200)
        .u24((1 << 3) | 6 | 1)
        .u8(0)
        .take(),
      /cannot be unpacked/,
    ],
    ["cut short", rawFrame(content).subarray(0, 150), /cut short/],
  ];
  for (const [name, frame, text] of faults) {
    const unpack = () => unzstd(frame, 200);
    assert.throws(unpack, (error) => error instanceof WireError && text.test(error.message), name);
  }
});

test("a record of the scene is taken, and may come again", () => {
  const records = new Records(OUTLINE);
  assert.equal(records.take(record(6)), true);
  assert.equal(records.take(record(6)), false);
  const sibling = record(7, { worldMin: [6, 2, -3], worldMax: [7, 2, 3.5], origin: [6.5, 1e6, 0] });
  assert.equal(records.take(sibling), true, "another level of the same node");
  assert.deepEqual([records.count, records.get(7), records.get(8)], [2, sibling, undefined]);
  assert.deepEqual([...records.ids()], [6, 7]);
});

test("a record that cannot be of the scene is refused, for each reason", () => {
  const faults: [Partial<DrawableRecord>, string][] = [
    [{ id: 600 }, "it has drawable 600, and the scene only 600 of these"],
    [{ node: 400 }, "it has node 400, and the scene only 400 of these"],
    [{ geometry: 250 }, "it has geometry 250, and the scene only 250 of these"],
    [{ object: 100 }, "it has object 100, and the scene only 100 of these"],
    [{ worldMin: [Number.NaN, 2, -3] }, "a number is not finite"],
    [{ worldMax: [9, Number.POSITIVE_INFINITY, 9] }, "a number is not finite"],
    [{ origin: [0, 0, Number.NEGATIVE_INFINITY] }, "a number is not finite"],
    [{ linear: [1, 0, 0, 0, 1, 0, 0, 0, Number.NaN] }, "a number is not finite"],
    [{ worldMin: [6, 2.5, -3] }, "its box is inside out"],
    [{ sides: 0x1000000 }, "its sides are unknown"],
    [{ triangles: 0 }, "it has no triangles"],
  ];
  for (const [change, text] of faults) {
    const changed = record(6, change);
    const fault = new WireError(`the record of drawable ${changed.id}: ${text}`);
    const records = new Records(OUTLINE);
    assert.throws(() => records.take(changed), fault);
    assert.equal(records.count, 0);
  }
  const largest = record(599, { node: 399, geometry: 249, object: 99, worldMax: [600, 2, -3] });
  assert.equal(new Records(OUTLINE).take(largest), true);
});

test("a drawable or node that came before as another one is refused", () => {
  const changes: Partial<DrawableRecord>[] = [
    { node: 8 },
    { geometry: 8 },
    { triangles: 8 },
    { sides: 1 },
    // The same node in another drawable, but moved.
    { id: 7, worldMin: [5, 2, -3] },
    { id: 7, worldMax: [8, 2, 3.5] },
    { id: 7, origin: [0, 0, 0] },
    { id: 7, linear: [2, 0, 0, 0, 1, 0, 0, 0, 1] },
    { id: 7, object: 8 },
    { id: 7, objects: 2 },
  ];
  for (const change of changes) {
    const records = new Records(OUTLINE);
    records.take(record(6));
    const another = /came once more, and is another one/;
    assert.throws(() => records.take({ ...record(6), ...change }), another, JSON.stringify(change));
    assert.deepEqual([records.count, records.get(6)], [1, record(6)]);
  }
});

test("no more records are kept than there may be", () => {
  const records = new Records(OUTLINE, 2);
  records.take(record(2));
  records.take(record(4));
  records.take(record(4));
  assert.throws(() => records.take(record(6)), new WireError("more than 2 records came"));
});
