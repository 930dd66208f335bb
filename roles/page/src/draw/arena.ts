/** Vertices and indices of many pieces of geometry in two buffers of the device, so that one call draws many. */

import type { Piece } from "../proto/piece.ts";
import { VERTEX_BYTES } from "../proto/piece.ts";
import { Allocator, type Place } from "./allocator.ts";

/** What buffers hold at first: vertices, and indices. */
const FIRST_VERTICES = 1 << 16;
const FIRST_INDICES = 1 << 18;

/** Where a piece's triangles are. */
export interface Range {
  /** Where its indices begin, in bytes. */
  readonly byteOffset: number;
  /** How many indices. */
  readonly count: number;
}

export class Arena {
  readonly #gl: WebGL2RenderingContext;
  readonly #vertices: GrowingBuffer;
  readonly #indices: GrowingBuffer;
  readonly #pieces = new Map<number, { vertices: Place; indices: Place; range: Range }>();
  readonly vertexArray: WebGLVertexArrayObject;

  constructor(gl: WebGL2RenderingContext) {
    this.#gl = gl;
    this.vertexArray = gl.createVertexArray();
    this.#vertices = new GrowingBuffer(gl, gl.ARRAY_BUFFER, VERTEX_BYTES, FIRST_VERTICES);
    this.#indices = new GrowingBuffer(gl, gl.ELEMENT_ARRAY_BUFFER, 4, FIRST_INDICES);
    this.#bind();
  }

  /** Bytes on the device that hold geometry. */
  get bytes(): number {
    return this.#vertices.bytes + this.#indices.bytes;
  }

  /** Where the triangles of a piece are, if it is there. */
  range(piece: number): Range | undefined {
    return this.#pieces.get(piece)?.range;
  }

  set(piece: number, { vertices, indices }: Piece): void {
    this.drop(piece);
    const gl = this.#gl;
    // An array of vertices that is bound would take the buffer of indices for its own.
    gl.bindVertexArray(null);
    const [of, grownVertices] = this.#vertices.take(vertices.length / VERTEX_BYTES);
    const [at, grownIndices] = this.#indices.take(indices.length);
    // The last corner of a triangle decides what is flat in it: the first one is put there. The order of the
    // corners stays what it is.
    const turned = new Uint32Array(indices.length);
    for (let i = 0; i < indices.length; i += 3) {
      turned[i] = (indices[i + 1] ?? 0) + of.offset;
      turned[i + 1] = (indices[i + 2] ?? 0) + of.offset;
      turned[i + 2] = (indices[i] ?? 0) + of.offset;
    }
    this.#vertices.write(of, vertices);
    this.#indices.write(at, turned);
    if (grownVertices || grownIndices) {
      this.#bind();
    }
    const range = { byteOffset: 4 * at.offset, count: at.length };
    this.#pieces.set(piece, { vertices: of, indices: at, range });
  }

  drop(piece: number): void {
    const held = this.#pieces.get(piece);
    if (held !== undefined) {
      this.#vertices.give(held.vertices);
      this.#indices.give(held.indices);
      this.#pieces.delete(piece);
    }
  }

  #bind(): void {
    const gl = this.#gl;
    gl.bindVertexArray(this.vertexArray);
    this.#vertices.bind();
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, VERTEX_BYTES, 0);
    gl.enableVertexAttribArray(1);
    gl.vertexAttribPointer(1, 4, gl.UNSIGNED_BYTE, true, VERTEX_BYTES, 12);
    gl.enableVertexAttribArray(2);
    gl.vertexAttribPointer(2, 2, gl.SHORT, true, VERTEX_BYTES, 16);
    this.#indices.bind();
    gl.bindVertexArray(null);
  }
}

/** A buffer that doubles where it is full; what it holds stays where it is. */
class GrowingBuffer {
  readonly #gl: WebGL2RenderingContext;
  readonly #target: number;
  readonly #size: number;
  readonly #places = new Allocator();
  #buffer: WebGLBuffer;

  constructor(gl: WebGL2RenderingContext, target: number, size: number, first: number) {
    [this.#gl, this.#target, this.#size] = [gl, target, size];
    this.#buffer = this.#make(first);
    this.#places.grow(first);
  }

  get bytes(): number {
    return this.#places.used * this.#size;
  }

  /** A place for so many, and whether the buffer is another one now. */
  take(count: number): [Place, boolean] {
    const place = this.#places.take(count);
    if (place !== undefined) {
      return [place, false];
    }
    const before = this.#places.capacity;
    let capacity = before;
    do {
      capacity *= 2;
    } while (capacity - before < count);
    const [gl, old] = [this.#gl, this.#buffer];
    this.#buffer = this.#make(capacity);
    gl.bindBuffer(gl.COPY_READ_BUFFER, old);
    gl.bindBuffer(this.#target, this.#buffer);
    gl.copyBufferSubData(gl.COPY_READ_BUFFER, this.#target, 0, 0, before * this.#size);
    gl.bindBuffer(gl.COPY_READ_BUFFER, null);
    gl.deleteBuffer(old);
    this.#places.grow(capacity);
    // There is room now.
    return [this.#places.take(count) ?? { offset: 0, length: 0 }, true];
  }

  give(place: Place): void {
    this.#places.give(place);
  }

  write({ offset }: Place, data: Uint8Array<ArrayBuffer> | Uint32Array<ArrayBuffer>): void {
    this.bind();
    this.#gl.bufferSubData(this.#target, offset * this.#size, data);
  }

  bind(): void {
    this.#gl.bindBuffer(this.#target, this.#buffer);
  }

  #make(capacity: number): WebGLBuffer {
    const gl = this.#gl;
    const buffer = gl.createBuffer();
    gl.bindBuffer(this.#target, buffer);
    gl.bufferData(this.#target, capacity * this.#size, gl.STATIC_DRAW);
    return buffer;
  }
}
