/** A part of the device's memory for geometry: a vertex buffer and an index buffer of fixed size. */

import { VERTEX_BYTES } from "../proto/piece.ts";
import { Allocator, type Place } from "./allocator.ts";
import type { Provoking } from "./features.ts";
import type { Mesh, Triangles } from "./model.ts";

const INDEX_BYTES = 4;

/** The attributes of a vertex. */
export const POSITION = 0;
export const COLOUR = 1;
export const NORMAL = 2;

/** The place of a mesh in a page. */
export interface Spot {
  readonly vertices: Place;
  readonly indices: Place;
}

/** Indices on their way to the device, in a reused buffer. */
let scratch = new Uint32Array(1 << 12);

export class GeometryPage {
  readonly #gl: WebGL2RenderingContext;
  readonly #provoking: Provoking;
  readonly #vertices: Allocator;
  readonly #indices: Allocator;
  readonly #vertexBuffer: WebGLBuffer;
  readonly #indexBuffer: WebGLBuffer;
  readonly #array: WebGLVertexArrayObject;

  /** Throws if the device is out of memory. */
  constructor(gl: WebGL2RenderingContext, provoking: Provoking, vertices: number, indices: number) {
    [this.#gl, this.#provoking] = [gl, provoking];
    [this.#vertices, this.#indices] = [new Allocator(vertices), new Allocator(indices)];
    this.#array = gl.createVertexArray();
    this.#vertexBuffer = gl.createBuffer();
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
    return this.#vertices.capacity * VERTEX_BYTES + this.#indices.capacity * INDEX_BYTES;
  }

  /** Bytes that meshes take. */
  get used(): number {
    return this.#vertices.used * VERTEX_BYTES + this.#indices.used * INDEX_BYTES;
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
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.#indexBuffer);
    if (scratch.length < indices.length) {
      scratch = new Uint32Array(2 * indices.length);
    }
    moveIndices(indices, ownVertices.offset, this.#provoking, scratch);
    const start = ownIndices.offset * INDEX_BYTES;
    gl.bufferSubData(gl.ELEMENT_ARRAY_BUFFER, start, scratch, 0, indices.length);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, null);
    return { vertices: ownVertices, indices: ownIndices };
  }

  /** The positions and indices of a mesh, read back from the device: waits for pending drawing. */
  read({ vertices, indices }: Spot): Triangles {
    const gl = this.#gl;
    const words = new Float32Array((vertices.length * VERTEX_BYTES) / 4);
    const corners = new Uint32Array(indices.length);
    gl.bindVertexArray(null);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.#vertexBuffer);
    gl.getBufferSubData(gl.ARRAY_BUFFER, vertices.offset * VERTEX_BYTES, words);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.#indexBuffer);
    gl.getBufferSubData(gl.ELEMENT_ARRAY_BUFFER, indices.offset * INDEX_BYTES, corners);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, null);
    const each = VERTEX_BYTES / 4;
    const positions = new Float32Array(3 * vertices.length);
    for (let vertex = 0; vertex < vertices.length; vertex += 1) {
      positions.set(words.subarray(each * vertex, each * vertex + 3), 3 * vertex);
    }
    return { positions, indices: corners.map((corner) => corner - vertices.offset) };
  }

  remove({ vertices, indices }: Spot): void {
    this.#vertices.give(vertices);
    this.#indices.give(indices);
  }

  /** Draws use this page from now on. */
  bind(): void {
    this.#gl.bindVertexArray(this.#array);
  }

  delete(): void {
    this.#gl.deleteVertexArray(this.#array);
    this.#gl.deleteBuffer(this.#vertexBuffer);
    this.#gl.deleteBuffer(this.#indexBuffer);
  }
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
