/** Records of drawables unpack, and invalid ones are refused. */

import assert from "node:assert/strict";
import { test } from "node:test";
import { WireError, Writer } from "trimaran-transport";
import { type DrawableRecord, Records, unpackRecords } from "../src/proto/records.ts";
import { unzstd } from "../src/proto/zstd.ts";
import { fromHex, range } from "../wire/tests/support.ts";
import { packRecords, rawFrame } from "./packing.ts";

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
    level: id & ~1,
    pieces: 2,
    ...change,
  };
}

/** 40 records, packed by zstd at level 3, with a checksum. */
const PACKED = `
28 00 28 b5 2f fd 64 80 15 0d 09 00 24 09 00 00 80 80 40 00 c0 08 18 22 28 2e 32 35 38 3b 3e 40 42
43 45 46 48 49 4b 4c 4e 4f 50 51 52 52 53 54 55 55 56 57 58 58 59 5a 5b 5b 5c 5d 00 40 00 40 00 08
c0 00 f0 10 1c 24 2a 30 33 36 39 3c 3f 41 42 44 45 47 48 4a 4b 4d 4e 50 50 51 52 53 53 54 55 56 56
57 58 59 59 5a 5b 5c 5c 5d 3f 40 0c 80 c0 40 a0 60 20 e0 e0 0c 1a 23 29 2f 3f 80 84 2e 41 80 3f 80
3f 80 3f 00 03 00 01 02 00 f9 fd 00 ff 0c 0c 0c 00 00 00 01 00 07 01 01 02 04 02 02 3f 20 20 83 4b
92 36 07 21 58 28 e8 41 a0 60 28 e0 41 9a b1 50 d0 83 01 14 32 97 de 2c 65 aa 32 cf 20 9b 0e c8 a5
07 7a 45 41 1f 1c ff 0c 0d 3d 05 fa 60 95 b2 4f a3 14 ca eb a6 46 43 81 f2 2c 39 9f 6a 71 86 f2 28
b9 83 b2 36 2a 28 8f 92 b9 14 28 8f 78 29 36 b8 1c f8 32 87 22 2c 9e 87 32 5c c9 f0 a1 a6 0c d0 27
80 80 6d d4 4d 41 f4 8a 39 0d c6 9b 4e 08 57 00 94 3a 4b 46 29 6c d4 51 32 0a 55 91 f8 29 df b3 1b
73 52 b0 0d cb c4 46 74
`;

test("records read back, whatever their order", () => {
  for (const ids of [[], [5], [5, 6, 9], [9, 0, 6], range(0, 249)]) {
    const records = ids.map((id) => record(id, { worldMin: [id - 0.1, 2, -3] }));
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
  const repeated = (times: number, window = 0x38) =>
    new Writer()
      .u32(0xfd2fb528)
      .u8(0)
      .u8(window)
      .u24(2 << 3)
      .bytes(Uint8Array.of(1, 2))
      .u24((times << 3) | 2 | 1)
      .u8(9)
      .take();
  // Windows of 128 kB, 7.5 MB and 8 MB, with a kB of 1024 bytes.
  for (const window of [0x38, 0x67, 0x68]) {
    assert.deepEqual(unzstd(repeated(3, window), 5), Uint8Array.of(1, 2, 9, 9, 9));
  }
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
    ["a window of nine megabytes", repeated(198, 0x69), /window of more than 8388608 bytes/],
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
    [{ pieces: 0 }, "it is no piece of its level"],
    [{ pieces: 65_536 }, "it is no piece of its level"],
    [{ level: 500 }, "it is no piece of its level"],
  ];
  for (const [change, text] of faults) {
    const changed = record(6, change);
    const fault = new WireError(`the record of drawable ${changed.id}: ${text}`);
    const records = new Records(OUTLINE);
    assert.throws(() => records.take(changed), fault);
    assert.equal(records.count, 0);
  }
  const worldMax = [600, 2, -3] as const;
  const largest = record(599, { node: 399, geometry: 249, object: 99, pieces: 65_535, worldMax });
  assert.equal(new Records(OUTLINE).take(largest), true);
});

test("a drawable or node that came before as another one is refused", () => {
  const changes: Partial<DrawableRecord>[] = [
    { node: 8 },
    { geometry: 8 },
    { triangles: 8 },
    { sides: 1 },
    { worldMin: [5, 2, -3] },
    { worldMax: [8, 2, 3.5] },
    { level: 5 },
    { pieces: 3 },
    // The same node in another drawable, but moved.
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
