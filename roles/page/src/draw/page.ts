/** A part of the device's memory for geometry: buffers of fixed size for vertices and indices. */

import { SOFT_BYTES, VERTEX_BYTES } from "../proto/piece.ts";
import { Allocator, type Place } from "./allocator.ts";
import type { Blocks } from "./blocks.ts";
import type { Provoking } from "./features.ts";
import type { Mesh, Triangles } from "./model.ts";
import type { Soft } from "./normals.ts";
import type { Flat } from "./surface.ts";

const INDEX_BYTES = 4;
/** Words of four bytes of a vertex, without its smooth normal. */
export const WORDS_EACH = VERTEX_BYTES / 4;
/** Bytes of a vertex on the device, in two buffers: moving pictures do not read that of smooth normals. */
export const DEVICE_BYTES = VERTEX_BYTES + SOFT_BYTES;

/** The attributes of a vertex. */
export const POSITION = 0;
export const COLOUR = 1;
export const NORMAL = 2;
export const SOFT = 3;

/** The place of a mesh in a page. */
export interface Spot {
  readonly vertices: Place;
  readonly indices: Place;
  /** Copies of vertices where several round surfaces meet: see `normals.ts`. */
  copies?: { readonly place: Place; readonly originals: Uint32Array };
}

const NOWHERE: Place = { offset: 0, length: 0 };
/** No vertex has a normal for smooth shading. */
const FLAT = { codes: new Uint32Array(0), copies: new Uint32Array(0) };

/** Indices on their way to the device, in a reused buffer. */
let scratch = new Uint32Array(1 << 12);

export class GeometryPage {
  readonly #gl: WebGL2RenderingContext;
  readonly #provoking: Provoking;
  readonly #vertices: Allocator;
  readonly #indices: Allocator;
  readonly #vertexBuffer: WebGLBuffer;
  readonly #softBuffer: WebGLBuffer;
  readonly #indexBuffer: WebGLBuffer;
  readonly #array: WebGLVertexArrayObject;

  /** Throws if the device is out of memory. */
  constructor(gl: WebGL2RenderingContext, provoking: Provoking, vertices: number, indices: number) {
    [this.#gl, this.#provoking] = [gl, provoking];
    [this.#vertices, this.#indices] = [new Allocator(vertices), new Allocator(indices)];
    this.#array = gl.createVertexArray();
    this.#vertexBuffer = gl.createBuffer();
    this.#softBuffer = gl.createBuffer();
    this.#indexBuffer = gl.createBuffer();
    gl.bindVertexArray(this.#array);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.#vertexBuffer);
    gl.bufferData(gl.ARRAY_BUFFER, vertices * VERTEX_BYTES, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(POSITION);
    gl.vertexAttribPointer(POSITION, 3, gl.FLOAT, false, VERTEX_BYTES, 0);
    gl.enableVertexAttribArray(COLOUR);
    gl.vertexAttribPointer(COLOUR, 4, gl.UNSIGNED_BYTE, true, VERTEX_BYTES, 12);
    gl.enableVertexAttribArray(NORMAL);
    gl.vertexAttribPointer(NORMAL, 2, gl.SHORT, true, VERTEX_BYTES, 16);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.#softBuffer);
    gl.bufferData(gl.ARRAY_BUFFER, vertices * SOFT_BYTES, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(SOFT);
    gl.vertexAttribIPointer(SOFT, 1, gl.UNSIGNED_INT, SOFT_BYTES, 0);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.#indexBuffer);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, indices * INDEX_BYTES, gl.STATIC_DRAW);
    gl.bindVertexArray(null);
    if (gl.getError() === gl.OUT_OF_MEMORY) {
      this.delete();
      throw new Error(`the graphics device has no memory for ${this.capacity} more bytes of geometry`);
    }
  }

  /** Bytes on the device, used or free. */
  get capacity(): number {
    return this.#vertices.capacity * DEVICE_BYTES + this.#indices.capacity * INDEX_BYTES;
  }

  /** Bytes that meshes take. */
  get used(): number {
    return this.#vertices.used * DEVICE_BYTES + this.#indices.used * INDEX_BYTES;
  }

  /** Adds a mesh; nothing if there is no room. */
  add({ vertices, indices }: Mesh): Spot | undefined {
    const ownVertices = this.#vertices.take(vertices.length / VERTEX_BYTES);
    if (ownVertices === undefined) {
      return undefined;
    }
    const ownIndices = this.#indices.take(indices.length);
    if (ownIndices === undefined) {
      this.#vertices.give(ownVertices);
      return undefined;
    }
    const gl = this.#gl;
    // A bound vertex array would capture the index buffer.
    gl.bindVertexArray(null);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.#vertexBuffer);
    gl.bufferSubData(gl.ARRAY_BUFFER, ownVertices.offset * VERTEX_BYTES, vertices);
    if (scratch.length < indices.length) {
      scratch = new Uint32Array(2 * indices.length);
    }
    moveIndices(indices, ownVertices.offset, this.#provoking, scratch);
    this.#writeIndices(ownIndices, scratch);
    return { vertices: ownVertices, indices: ownIndices };
  }

  #writeIndices({ offset, length }: Place, indices: Uint32Array): void {
    const gl = this.#gl;
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.#indexBuffer);
    gl.bufferSubData(gl.ELEMENT_ARRAY_BUFFER, offset * INDEX_BYTES, indices, 0, length);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, null);
  }

  /** A mesh as it was added, except that the provoking vertex may be the last. `blocks` read the device. */
  flat(spot: Spot, blocks: Blocks): Flat {
    const { vertices, indices } = spot;
    const [start, length] = [WORDS_EACH * vertices.offset, WORDS_EACH * vertices.length];
    const words = blocks.read(this.#vertexBuffer, WORDS_EACH * this.#vertices.capacity, start, length);
    const corners = blocks.read(this.#indexBuffer, this.#indices.capacity, indices.offset, indices.length);
    return { words: new Float32Array(words.buffer), indices: ownIndices(corners, spot) };
  }

  /** Sets the normals of a mesh for smooth shading. It stays flat if there is no room for copies. */
  soften(spot: Spot, { words, indices: flat }: Flat, soft: Soft): void {
    const gl = this.#gl;
    const { vertices, indices } = spot;
    const had = spot.copies;
    this.#vertices.give(had?.place ?? NOWHERE);
    const place = this.#vertices.take(soft.copies.length);
    const { codes, copies: originals } = place === undefined ? FLAT : soft;
    const own = new Uint32Array(vertices.length);
    own.set(codes.subarray(0, vertices.length));
    gl.bindVertexArray(null);
    this.#writeSoft(vertices, own);
    if (place === undefined || originals.length === 0) {
      delete spot.copies;
    } else {
      spot.copies = { place, originals };
      this.#writeSoft(place, codes.subarray(vertices.length));
      const copied = new Float32Array(WORDS_EACH * originals.length);
      for (const [at, original] of originals.entries()) {
        copied.set(words.subarray(WORDS_EACH * original, WORDS_EACH * (original + 1)), WORDS_EACH * at);
      }
      gl.bindBuffer(gl.ARRAY_BUFFER, this.#vertexBuffer);
      gl.bufferSubData(gl.ARRAY_BUFFER, place.offset * VERTEX_BYTES, copied);
    }
    if (had !== undefined || spot.copies !== undefined) {
      const [count, first] = [vertices.length, spot.copies?.place.offset ?? 0];
      const corners = place === undefined ? flat : soft.indices;
      const moved = corners.map((i) => (i < count ? vertices.offset + i : first + i - count));
      this.#writeIndices(indices, moved);
    }
  }

  #writeSoft({ offset }: Place, codes: Uint32Array): void {
    const gl = this.#gl;
    gl.bindBuffer(gl.ARRAY_BUFFER, this.#softBuffer);
    gl.bufferSubData(gl.ARRAY_BUFFER, offset * SOFT_BYTES, codes);
  }

  /** The positions and indices of a mesh, read back from the device: waits for pending drawing. */
  read(spot: Spot): Triangles {
    const { vertices, indices } = spot;
    const gl = this.#gl;
    const words = new Float32Array(vertices.length * WORDS_EACH);
    const corners = new Uint32Array(indices.length);
    gl.bindVertexArray(null);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.#vertexBuffer);
    gl.getBufferSubData(gl.ARRAY_BUFFER, vertices.offset * VERTEX_BYTES, words);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.#indexBuffer);
    gl.getBufferSubData(gl.ELEMENT_ARRAY_BUFFER, indices.offset * INDEX_BYTES, corners);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, null);
    const positions = new Float32Array(3 * vertices.length);
    for (let vertex = 0; vertex < vertices.length; vertex += 1) {
      positions.set(words.subarray(WORDS_EACH * vertex, WORDS_EACH * vertex + 3), 3 * vertex);
    }
    return { positions, indices: ownIndices(corners, spot) };
  }

  remove({ vertices, indices, copies }: Spot): void {
    this.#vertices.give(vertices);
    this.#vertices.give(copies?.place ?? NOWHERE);
    this.#indices.give(indices);
  }

  /** Draws use this page from now on. */
  bind(): void {
    this.#gl.bindVertexArray(this.#array);
  }

  delete(): void {
    this.#gl.deleteVertexArray(this.#array);
    this.#gl.deleteBuffer(this.#vertexBuffer);
    this.#gl.deleteBuffer(this.#softBuffer);
    this.#gl.deleteBuffer(this.#indexBuffer);
  }
}

/** A mesh's own indices, out of those of its page: copies are the vertices that they were made of. */
function ownIndices(corners: Uint32Array, { vertices, copies }: Spot): Uint32Array {
  const [from, originals] = [copies?.place.offset ?? 0, copies?.originals];
  return corners.map((corner) => originals?.[corner - from] ?? corner - vertices.offset);
}

/** The first byte of a spot's indices. */
export function byteOffset({ indices }: Spot): number {
  return indices.offset * INDEX_BYTES;
}

/**
 * Writes indices to `into` that count from the page's first vertex, `by` before the mesh's own.
 *
 * If the last corner is the provoking vertex, the first one is moved there. The winding stays.
 */
export function moveIndices(indices: Uint32Array, by: number, provoking: Provoking, into: Uint32Array): void {
  const [first, second, third] = provoking === "first" ? [0, 1, 2] : [2, 0, 1];
  for (let i = 0; i + 2 < indices.length; i += 3) {
    into[i + first] = (indices[i] ?? 0) + by;
    into[i + second] = (indices[i + 1] ?? 0) + by;
    into[i + third] = (indices[i + 2] ?? 0) + by;
  }
}
