/** Pieces of geometry: they arrive in parts, and are packed by meshoptimizer's codecs. */

import { MeshoptDecoder } from "meshoptimizer/decoder";
import { Reader, WireError, Writer } from "trimaran-transport";

import type { PiecePart } from "./supply.ts";

/** The bytes of a vertex: position (3 f32), sRGB colour (4 u8), folded normal (2 i16). */
export const VERTEX_BYTES = 20;

/** The bytes that drawing adds to a vertex: its normal on a round surface (see `draw/normals.ts`). */
export const SOFT_BYTES = 4;

/** The most bytes of a piece, packed. */
export const LARGEST_PIECE = 64 << 20;

/** An unpacked piece. */
export interface Piece {
  /** 20 bytes each. */
  readonly vertices: Uint8Array<ArrayBuffer>;
  /** Three a triangle. The first of the three carries the triangle's colour and normal. */
  readonly indices: Uint32Array<ArrayBuffer>;
  /** How many triangles there are. */
  readonly triangles: number;
}

/** A complete piece, packed. */
export interface WholePiece {
  readonly number: number;
  readonly bytes: Uint8Array<ArrayBuffer>;
}

/** Puts the parts of one culler's pieces together. */
export class PieceAssembler {
  #arriving: { readonly number: number; readonly length: number; readonly bytes: Writer } | undefined;

  /** Takes the next part. Returns the piece if that was the last one. */
  take({ number, length, offset, part }: PiecePart): WholePiece | undefined {
    if (length > LARGEST_PIECE) {
      throw new WireError(`the geometry ${number} has ${length} bytes: ${LARGEST_PIECE} is the most`);
    }
    const arriving = this.#arriving ?? { number, length, bytes: new Writer() };
    const { bytes } = arriving;
    const isDue = arriving.number === number && arriving.length === length && bytes.length === offset;
    if (!isDue || offset + part.length > length) {
      throw new WireError(`a part of the geometry ${number} came that is not due`);
    }
    bytes.bytes(part);
    const isWhole = bytes.length === length;
    this.#arriving = isWhole ? undefined : arriving;
    return isWhole ? { number, bytes: bytes.take() } : undefined;
  }
}

/** Resolves once pieces can be unpacked: the codecs are WebAssembly, which takes a moment to load. */
export function loadCodecs(): Promise<void> {
  return MeshoptDecoder.ready;
}

/** Unpacks a piece. Throws a `WireError` if it is invalid. Await `loadCodecs` before. */
export function unpackPiece(bytes: Uint8Array): Piece {
  const reader = new Reader(bytes);
  const [count, triangles, packedLength] = [reader.u32(), reader.u32(), reader.u32()];
  const packedVertices = reader.bytes(packedLength);
  const rest = reader.rest();
  const turnBytes = Math.ceil(triangles / 4);
  if (triangles > rest.length || turnBytes > rest.length || count > 3 * triangles) {
    throw new WireError(`a piece of ${bytes.length} bytes is too short for what it says it holds`);
  }
  if (Math.max(count * VERTEX_BYTES, triangles * TRIANGLE_BYTES) > LARGEST_UNPACKED) {
    throw new WireError(`a piece says that it holds ${count} vertices and ${triangles} triangles`);
  }
  const indices = decodeIndices(rest.subarray(turnBytes), triangles);
  const vertices = decodeVertices(packedVertices, count);
  turn(indices, rest.subarray(0, turnBytes));
  check(vertices, indices, count);
  return { vertices, indices, triangles };
}

/** Bytes of a triangle's three indices. */
const TRIANGLE_BYTES = 12;

/** The most bytes of unpacked vertices or indices: the limit of the codecs' memory. */
const LARGEST_UNPACKED = 1 << 30;

function decodeIndices(packed: Uint8Array, triangles: number): Uint32Array<ArrayBuffer> {
  const indices = new Uint32Array(3 * triangles);
  const bytes = new Uint8Array(indices.buffer);
  decoding("indices", () => MeshoptDecoder.decodeIndexBuffer(bytes, indices.length, 4, packed));
  return indices;
}

function decodeVertices(packed: Uint8Array, count: number): Uint8Array<ArrayBuffer> {
  const vertices = new Uint8Array(count * VERTEX_BYTES);
  decoding("vertices", () => MeshoptDecoder.decodeVertexBuffer(vertices, count, VERTEX_BYTES, packed));
  return vertices;
}

function decoding(what: string, decode: () => void): void {
  try {
    decode();
  } catch {
    throw new WireError(`the ${what} of a piece cannot be unpacked`);
  }
}

/** Rotates each triangle so that the corner with colour and normal comes first. */
function turn(indices: Uint32Array, turns: Uint8Array): void {
  for (let first = 0; first < indices.length; first += 3) {
    const triangle = first / 3;
    const by = ((turns[triangle >>> 2] ?? 0) >>> (2 * (triangle & 3))) & 3;
    if (by === 1 || by === 2) {
      const corners = [indices[first] ?? 0, indices[first + 1] ?? 0, indices[first + 2] ?? 0];
      for (let corner = 0; corner < 3; corner += 1) {
        indices[first + corner] = corners[(corner + by) % 3] ?? 0;
      }
    }
  }
}

/** Checks that all positions are finite, and all indices have a vertex. */
function check(vertices: Uint8Array<ArrayBuffer>, indices: Uint32Array, count: number): void {
  const words = new Float32Array(vertices.buffer);
  const wordsEach = VERTEX_BYTES / 4;
  for (let at = 0; at < count; at += 1) {
    for (let axis = 0; axis < 3; axis += 1) {
      if (!Number.isFinite(words[wordsEach * at + axis])) {
        throw new WireError(`the position of vertex ${at} of a piece is not finite`);
      }
    }
  }
  if (indices.some((index) => index >= count)) {
    throw new WireError("an index of a piece has no vertex");
  }
}
