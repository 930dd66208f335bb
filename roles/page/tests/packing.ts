/** Packs records and pieces like a culler: the counterpart of the page's decoder. */

import { MeshoptEncoder } from "meshoptimizer/encoder";
import { Writer } from "trimaran-transport";
import type { DrawableRecord } from "../src/proto/records.ts";
import { range } from "../wire/tests/support.ts";

/** The columns of records, before zstd. */
export function columnsOf(records: readonly DrawableRecord[]): Uint8Array<ArrayBuffer> {
  const writer = new Writer();
  for (const [at, record] of records.entries()) {
    const before = records[at - 1] ?? { id: 0, node: 0, geometry: 0, object: 0, level: 0 };
    for (const number of [...record.worldMin, ...record.worldMax, ...record.origin]) {
      writer.f64(number);
    }
    for (const number of record.linear) {
      writer.f32(number);
    }
    writer
      .u32(record.id - before.id)
      .u32(record.node - before.node)
      .u32(record.geometry - before.geometry);
    writer
      .u32(record.triangles)
      .u32(record.sides)
      .u32(record.object - before.object)
      .u32(record.objects)
      .u32(record.level - before.level)
      .u32(record.pieces);
  }
  const rows = writer.take();
  const columns = range(0, 144).flatMap((column) => records.map((_, row) => rows[144 * row + column] ?? 0));
  return Uint8Array.from(columns);
}

/** Records in the wire format, in a zstd frame that stores them uncompressed. */
export function packRecords(records: readonly DrawableRecord[]): Uint8Array<ArrayBuffer> {
  return new Writer()
    .u16(records.length)
    .bytes(rawFrame(columnsOf(records)))
    .take();
}

/** A frame of zstd of one raw block: RFC 8878, 3.1.1. */
export function rawFrame(content: Uint8Array): Uint8Array<ArrayBuffer> {
  const writer = new Writer().u32(0xfd2fb528).u8(0xa0).u32(content.length);
  return writer
    .u24((content.length << 3) | 1)
    .bytes(content)
    .take();
}

/** A piece of these vertices and triangles in the wire format. */
export async function packPiece(
  vertices: Uint8Array,
  indices: Uint32Array,
): Promise<Uint8Array<ArrayBuffer>> {
  await MeshoptEncoder.ready;
  const [count, triangles] = [vertices.length / 20, indices.length / 3];
  const packedVertices = MeshoptEncoder.encodeVertexBuffer(vertices, count, 20);
  const packedIndices = MeshoptEncoder.encodeIndexBuffer(new Uint8Array(indices.buffer), indices.length, 4);
  const turns = await turnsOf(indices, packedIndices);
  const writer = new Writer().u32(count).u32(triangles).u32(packedVertices.length);
  return writer.bytes(packedVertices).bytes(turns).bytes(packedIndices).take();
}

/** How far packing has rotated the first corner of each triangle. */
async function turnsOf(indices: Uint32Array, packed: Uint8Array): Promise<Uint8Array> {
  const { MeshoptDecoder } = await import("meshoptimizer/decoder");
  await MeshoptDecoder.ready;
  const unpacked = new Uint32Array(indices.length);
  MeshoptDecoder.decodeIndexBuffer(new Uint8Array(unpacked.buffer), indices.length, 4, packed);
  const turns = new Uint8Array(Math.ceil(indices.length / 12));
  for (const triangle of range(0, indices.length / 3)) {
    const [a, b, c] = indices.subarray(3 * triangle, 3 * triangle + 3);
    const corners = [...unpacked.subarray(3 * triangle, 3 * triangle + 3)];
    const turn = [0, 1, 2].find((turn) => {
      return corners[turn] === a && corners[(turn + 1) % 3] === b && corners[(turn + 2) % 3] === c;
    });
    if (turn === undefined) {
      throw new Error("packing did more than turn a triangle");
    }
    turns[triangle >>> 2] = (turns[triangle >>> 2] ?? 0) | (turn << (2 * (triangle & 3)));
  }
  return turns;
}
