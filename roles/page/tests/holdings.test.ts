import assert from "node:assert/strict";
import { before, test } from "node:test";
import { WireError, Writer } from "trimaran-transport";
import { Holdings, type Store } from "../src/display/holdings.ts";
import { NUMBERS, numberList } from "../src/proto/numbers.ts";
import { loadCodecs } from "../src/proto/piece.ts";
import type { DrawableRecord } from "../src/proto/records.ts";
import { packPiece, packRecords } from "./packing.ts";

const OUTLINE = { hash: 1n, nodes: 10, drawables: 10, geometries: 10, objects: 10 };
/** Bytes of a triangle on the device: three vertices of 24 bytes, three indices of 4. */
const TRIANGLE = 84;

before(loadCodecs);

/** A record of the drawable that has the piece, node and object of its own number. */
function record(id: number, more: Partial<DrawableRecord> = {}): DrawableRecord {
  const own = { id, node: id, geometry: id, object: id, objects: 1, triangles: 1, sides: 0xffffff };
  const alone = { level: id, pieces: 1 };
  const linear = [1, 0, 0, 0, 1, 0, 0, 0, 1];
  return { ...own, ...alone, linear, origin: [0, 0, 0], worldMin: [0, 0, 0], worldMax: [1, 1, 1], ...more };
}

function entries(...records: DrawableRecord[]): Uint8Array {
  return new Writer().varint(0).byteString(packRecords(records)).take();
}

function piece(number: number, packed: Uint8Array): Uint8Array {
  const head = new Writer().varint(1).varint(number).varint(packed.length).varint(0);
  return head.byteString(packed).take();
}

function standIn(id: number, ...finer: number[]): Uint8Array {
  return level(id, 1, ...finer);
}

/** A level of so many pieces stands in. */
function level(id: number, pieces: number, ...finer: number[]): Uint8Array {
  const writer = new Writer().varint(2).varint(id).varint(pieces);
  NUMBERS.write(writer, numberList(finer));
  return writer.take();
}

const triangle = () => packPiece(new Uint8Array(60), Uint32Array.of(0, 1, 2));

class Pieces implements Store {
  readonly there = new Set<number>();

  setPiece(number: number): void {
    this.there.add(number);
  }

  dropPiece(number: number): void {
    this.there.delete(number);
  }
}

/** Holdings with these drawables and their pieces. */
async function having(budget: number, ...ids: number[]): Promise<[Holdings, Pieces]> {
  const pieces = new Pieces();
  const holdings = new Holdings(OUTLINE, pieces, budget);
  holdings.take(entries(...ids.map((id) => record(id))));
  for (const id of ids) {
    holdings.take(piece(id, await triangle()));
  }
  return [holdings, pieces];
}

test("a drawable is there once its record and its piece are", async () => {
  const pieces = new Pieces();
  const holdings = new Holdings(OUTLINE, pieces, 1 << 20);
  holdings.take(entries(record(3)));
  assert.deepEqual([...holdings.lacking(Uint32Array.of(3, 4))], [3, 4]);
  holdings.take(piece(3, await triangle()));
  assert.deepEqual([...holdings.lacking(Uint32Array.of(3, 4))], [4]);
  assert.deepEqual([...pieces.there], [3]);
  assert.equal(holdings.bytes, TRIANGLE);
});

test("a stand-in is shown once for all that it stands in for, and only if it is there", async () => {
  const [holdings] = await having(1 << 20, 1, 9);
  holdings.take(standIn(9, 2, 3));
  assert.deepEqual(holdings.standingIn(Uint32Array.of(1, 2, 3)), { shown: [1, 9], isWhole: true });
  assert.deepEqual(holdings.standingIn(Uint32Array.of(1, 4)), { shown: [1], isWhole: false });
  holdings.take(standIn(8, 3));
  assert.deepEqual(holdings.standingIn(Uint32Array.of(3)), { shown: [], isWhole: false });
});

test("a level in pieces stands in once all of them are there", async () => {
  const [holdings] = await having(1 << 20, 7);
  holdings.take(level(7, 2, 3));
  assert.deepEqual(holdings.standingIn(Uint32Array.of(3)), { shown: [], isWhole: false });
  holdings.take(entries(record(8)));
  holdings.take(piece(8, await triangle()));
  assert.deepEqual(holdings.standingIn(Uint32Array.of(3)), { shown: [7, 8], isWhole: true });
  holdings.take(level(7, 0, 3));
  assert.deepEqual(holdings.standingIn(Uint32Array.of(3)), { shown: [], isWhole: false });
});

test("beyond the budget goes what was not used for longest, and nothing that is shown", async () => {
  const [holdings, pieces] = await having(2 * TRIANGLE, 1, 2, 3, 4);
  const shown = (...ids: number[]) => [...holdings.use(ids.map((id) => record(id)))];
  assert.deepEqual(shown(1, 2, 3), [4]);
  assert.deepEqual(shown(2), [1]);
  assert.deepEqual([...pieces.there], [2, 3]);
  assert.deepEqual(shown(3), []);
  assert.equal(holdings.bytes, 2 * TRIANGLE);
});

test("whoever draws may lose everything, and it is taken again", async () => {
  const [holdings, pieces] = await having(1 << 20, 1, 2);
  assert.deepEqual([...holdings.loseAll()], [1, 2]);
  assert.deepEqual([...holdings.lacking(Uint32Array.of(1, 2))], [1, 2]);
  assert.equal(holdings.bytes, 0);
  pieces.there.clear();
  holdings.take(piece(2, await triangle()));
  assert.deepEqual([...holdings.lacking(Uint32Array.of(1, 2))], [1]);
  assert.deepEqual([...pieces.there], [2]);
});

test("a piece has the triangles that its drawables say, whichever comes first", async () => {
  const packed = await triangle();
  const lying = record(3, { triangles: 2 });
  const first = new Holdings(OUTLINE, new Pieces(), 1 << 20);
  first.take(entries(lying));
  assert.throws(() => first.take(piece(3, packed)), WireError);
  const last = new Holdings(OUTLINE, new Pieces(), 1 << 20);
  last.take(piece(3, packed));
  assert.throws(() => last.take(entries(lying)), WireError);
  const two = new Holdings(OUTLINE, new Pieces(), 1 << 20);
  assert.throws(() => two.take(entries(record(3), record(4, { geometry: 3, triangles: 2 }))), WireError);
  assert.throws(() => two.take(piece(10, packed)), WireError, "the scene has ten pieces");
});
