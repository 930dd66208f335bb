/** Parts make pieces, and pieces unpack to the original. */

import assert from "node:assert/strict";
import { test } from "node:test";
import { WireError, Writer } from "trimaran-transport";
import { LARGEST_PIECE, loadCodecs, PieceAssembler, unpackPiece } from "../src/proto/piece.ts";
import type { PiecePart } from "../src/proto/supply.ts";
import { concat, randomOf, range } from "../wire/tests/support.ts";
import { packPiece } from "./packing.ts";

await loadCodecs();

function someVertices(random: (below: number) => number, count: number): Uint8Array<ArrayBuffer> {
  const writer = new Writer();
  for (let vertex = 0; vertex < count; vertex += 1) {
    writer
      .f32(random(1000) / 8)
      .f32(-random(1000))
      .f32(random(9));
    writer.u32(random(2 ** 32)).u32(random(2 ** 32));
  }
  return writer.take();
}

const part = (number: number, length: number, offset: number, ...bytes: number[]): PiecePart => {
  return { number, length, offset, part: Uint8Array.from(bytes) };
};

test("pieces can be unpacked once the codecs are loaded", async () => {
  const packed = await packPiece(someVertices(randomOf(4), 3), Uint32Array.of(0, 1, 2));
  const unpacked = loadCodecs().then(() => unpackPiece(packed));
  assert.equal((await unpacked).triangles, 1);
});

test("pieces unpack to the byte, each triangle with the same corner first", async () => {
  const random = randomOf(5);
  let turned = 0;
  for (let round = 0; round < 100; round += 1) {
    const triangles = 1 + random(60);
    const count = 1 + random(3 * triangles);
    const vertices = someVertices(random, count);
    const indices = Uint32Array.from(range(0, 3 * triangles), () => random(count));
    const packed = await packPiece(vertices, indices);
    assert.deepEqual(unpackPiece(packed), { vertices, indices, triangles });
    const turns = packed.subarray(12 + new DataView(packed.buffer).getUint32(8, true));
    turned += turns.subarray(0, Math.ceil(triangles / 4)).filter((turn) => turn !== 0).length;
  }
  assert(turned > 100, "the codec turned triangles, so that turning back was needed");
});

test("a turn says which corner comes first, in the same order round", async () => {
  const vertices = someVertices(randomOf(6), 3);
  const packed = await packPiece(vertices, Uint32Array.of(0, 1, 2));
  const at = 12 + new DataView(packed.buffer).getUint32(8, true);
  const indicesWith = (turn: number) => {
    const changed = packed.slice();
    changed[at] = turn;
    return [...unpackPiece(changed).indices];
  };
  const [a = 0, b = 0, c = 0] = indicesWith(0);
  assert.deepEqual([a, b, c].sort(), [0, 1, 2]);
  assert.deepEqual(
    [indicesWith(1), indicesWith(2), indicesWith(3)],
    [
      [b, c, a],
      [c, a, b],
      [a, b, c],
    ],
  );
});

test("damaged pieces are refused or sound", async () => {
  const random = randomOf(7);
  const vertices = someVertices(random, 30);
  const indices = Uint32Array.from(range(0, 90), () => random(30));
  const packed = await packPiece(vertices, indices);
  let refused = 0;
  for (let round = 0; round < 1500; round += 1) {
    const damaged = packed.slice(0, random(2) === 0 ? random(packed.length) : packed.length);
    const at = random(damaged.length);
    if (damaged.length > 0) {
      damaged[at] = random(256);
    }
    try {
      const piece = unpackPiece(damaged);
      assert(piece.indices.every((index) => 20 * index < piece.vertices.length));
    } catch (error) {
      assert(error instanceof WireError, String(error));
      refused += 1;
    }
  }
  assert(refused > 500, `${refused} were refused`);
});

test("counts that do not go with the bytes are refused before memory is taken", async () => {
  const head = (vertices: number, triangles: number, length: number) => {
    return new Writer().u32(vertices).u32(triangles).u32(length);
  };
  const tooShort = (bytes: Uint8Array) =>
    new WireError(`a piece of ${bytes.length} bytes is too short for what it says it holds`);
  const largest = 0xffff_ffff;
  for (const bytes of [
    head(largest, largest, 0).take(),
    head(3, 2, 0).u8(0).take(),
    head(4, 1, 0).u32(0).take(),
  ]) {
    assert.throws(() => unpackPiece(bytes), tooShort(bytes));
  }
  assert.throws(() => unpackPiece(head(1, 1, 5).u32(0).take()), /cut short/);
  assert.throws(() => unpackPiece(new Uint8Array(11)), /cut short/);
  // A gigabyte is 53,687,091.2 vertices, or 89,478,485.3 triangles.
  const claim = (vertices: number, triangles: number) => () =>
    unpackPiece(head(vertices, triangles, 0).bytes(new Uint8Array(triangles)).take());
  assert.throws(claim(53_687_092, 17_895_698), /says that it holds 53687092 vertices and 17895698 triangles/);
  assert.throws(claim(3, 89_478_486), /says that it holds 3 vertices and 89478486 triangles/);
});

test("positions that are not finite and indices without a vertex are refused", async () => {
  const vertices = someVertices(randomOf(8), 3);
  new DataView(vertices.buffer).setFloat32(28, Number.NaN, true);
  const corners = Uint32Array.of(0, 1, 2);
  const notFinite = await packPiece(vertices, corners);
  assert.throws(
    () => unpackPiece(notFinite),
    new WireError("the position of vertex 1 of a piece is not finite"),
  );
  const beyond = await packPiece(someVertices(randomOf(8), 2), corners);
  assert.throws(() => unpackPiece(beyond), new WireError("an index of a piece has no vertex"));
  // Colour and normal may have any bits, also those of a NaN float.
  const odd = someVertices(randomOf(8), 3);
  odd.fill(0xff, 12, 20);
  assert.deepEqual(unpackPiece(await packPiece(odd, corners)).vertices, odd);
});

test("bytes that no codec wrote are refused by name", async () => {
  const packed = await packPiece(someVertices(randomOf(9), 3), Uint32Array.of(0, 1, 2));
  const noVertices = packed.slice();
  noVertices[12] = 0;
  assert.throws(() => unpackPiece(noVertices), new WireError("the vertices of a piece cannot be unpacked"));
  const noIndices = packed.slice();
  noIndices[13 + new DataView(packed.buffer).getUint32(8, true)] = 0;
  const onlyTurns = new Writer().u32(3).u32(1).u32(0).u8(0).take();
  for (const bytes of [noIndices, onlyTurns]) {
    assert.throws(() => unpackPiece(bytes), new WireError("the indices of a piece cannot be unpacked"));
  }
});

test("parts in order make a piece", () => {
  const assembler = new PieceAssembler();
  assert.equal(assembler.take(part(8, 5, 0, 1, 2)), undefined);
  assert.equal(assembler.take(part(8, 5, 2)), undefined);
  assert.equal(assembler.take(part(8, 5, 2, 3, 4)), undefined);
  assert.deepEqual(assembler.take(part(8, 5, 4, 5)), { number: 8, bytes: Uint8Array.of(1, 2, 3, 4, 5) });
  assert.deepEqual(assembler.take(part(9, 1, 0, 7)), { number: 9, bytes: Uint8Array.of(7) });
  assert.deepEqual(assembler.take(part(8, 1, 0, 6)), { number: 8, bytes: Uint8Array.of(6) });
});

test("a part that is not due is refused", () => {
  const faults: [string, PiecePart[]][] = [
    ["not from the first byte on", [part(8, 5, 1, 1)]],
    ["a gap", [part(8, 5, 0, 1), part(8, 5, 2, 1)]],
    ["twice", [part(8, 5, 0, 1), part(8, 5, 0, 1)]],
    ["of another piece between", [part(8, 5, 0, 1), part(9, 5, 1, 1)]],
    ["of another length", [part(8, 5, 0, 1), part(8, 6, 1, 1)]],
    ["beyond the end", [part(8, 2, 0, 1), part(8, 2, 1, 1, 1)]],
    ["beyond the end at once", [part(8, 1, 0, 1, 1)]],
  ];
  for (const [name, parts] of faults) {
    const assembler = new PieceAssembler();
    const last = parts.at(-1);
    assert(last !== undefined);
    for (const part of parts.slice(0, -1)) {
      assembler.take(part);
    }
    assert.throws(
      () => assembler.take(last),
      new WireError(`a part of the geometry ${last.number} came that is not due`),
      name,
    );
  }
  assert.equal(new PieceAssembler().take(part(8, LARGEST_PIECE, 0, 1)), undefined);
  assert.throws(() => new PieceAssembler().take(part(8, LARGEST_PIECE + 1, 0, 1)), /67108864 is the most/);
});

test("a piece that came in parts unpacks", async () => {
  const vertices = someVertices(randomOf(10), 48);
  const indices = Uint32Array.from(range(0, 48));
  const packed = await packPiece(vertices, indices);
  const assembler = new PieceAssembler();
  const pieces = range(0, Math.ceil(packed.length / 100)).map((at) => {
    const bytes = packed.subarray(100 * at, 100 * (at + 1));
    return assembler.take({ number: 3, length: packed.length, offset: 100 * at, part: bytes });
  });
  const whole = pieces.at(-1);
  assert(whole !== undefined && pieces.slice(0, -1).every((piece) => piece === undefined));
  assert.deepEqual(whole.bytes, concat(packed));
  assert.deepEqual(unpackPiece(whole.bytes), { vertices, indices, triangles: 16 });
});
