/** All drawables of a picture as few calls: their matrices lie in a texture, by the number of the draw. */

import type { GeometryArena, Range } from "./arena.ts";
import { BOTH, FACINGS, facingOf, MIRRORED } from "./facing.ts";
import type { Features } from "./features.ts";
import type { Drawable } from "./model.ts";
import type { Program } from "./program.ts";
import { PER_ROW, TEXELS } from "./shaders.ts";
import { at, MATRIX, type View } from "./view.ts";

/** Drawables that there is room for at first. */
const FIRST = 4096;
const FLOATS = 4 * TEXELS;

/** What a picture took. */
export interface Drawn {
  /** Calls to draw. */
  calls: number;
  /** Drawables that may be in the picture, and have their geometry here. */
  drawables: number;
  triangles: number;
}

/** Takes no memory for a picture that is no larger than one before. */
export class Batch {
  readonly #gl: WebGL2RenderingContext;
  readonly #multiDraw: WEBGL_multi_draw | null;
  readonly #texture: WebGLTexture;
  #capacity = 0;
  /** What is in view, in the order of the drawables: matrices, numbers, groups and ranges. */
  #found = new Float32Array(0);
  #ids = new Uint32Array(0);
  #groups = new Uint32Array(0);
  readonly #ranges: Range[] = [];
  /** The same in the order of the draws, as the device takes it. */
  #matrices = new Float32Array(0);
  #numbers = new Uint32Array(0);
  #counts = new Int32Array(0);
  #offsets = new Int32Array(0);
  /** Where the draws of each group end. */
  #ends = new Uint32Array(16);
  readonly drawn: Drawn = { calls: 0, drawables: 0, triangles: 0 };

  constructor(gl: WebGL2RenderingContext, { multiDraw }: Features) {
    [this.#gl, this.#multiDraw] = [gl, multiDraw];
    this.#texture = gl.createTexture();
    this.#reserve(FIRST);
  }

  /** Draws by `program` what is in view and has its geometry in `arena`. */
  draw(view: View, drawables: readonly Drawable[], arena: GeometryArena, program: Program): void {
    const gl = this.#gl;
    this.#reserve(drawables.length);
    const groups = FACINGS * arena.pages.length;
    const count = this.#find(view, drawables, arena, groups);
    this.#sort(count);
    this.#upload(count);
    this.drawn.calls = 0;
    this.drawn.drawables = count;
    const first = program.at("first");
    for (let group = 0; group < groups; group += 1) {
      const [start, end] = [group === 0 ? 0 : at(this.#ends, group - 1), at(this.#ends, group)];
      if (start < end) {
        arena.pages[Math.floor(group / FACINGS)]?.bind();
        this.#face(group % FACINGS);
        this.#call(start, end - start, first);
      }
    }
    this.#face(BOTH);
    gl.bindVertexArray(null);
  }

  #face(facing: number): void {
    const gl = this.#gl;
    if (facing === BOTH) {
      gl.disable(gl.CULL_FACE);
    } else {
      gl.enable(gl.CULL_FACE);
      gl.cullFace(facing === MIRRORED ? gl.FRONT : gl.BACK);
    }
  }

  /** Finds what is in view. A group is what one call draws: a page, and which sides of triangles can show. */
  #find(view: View, drawables: readonly Drawable[], arena: GeometryArena, groups: number): number {
    if (this.#ends.length < groups) {
      this.#ends = new Uint32Array(2 * groups);
    }
    this.#ends.fill(0);
    let [count, triangles] = [0, 0];
    for (const drawable of drawables) {
      const range = arena.range(drawable.geometry);
      if (range === undefined) {
        continue;
      }
      view.place(drawable);
      if (!view.sees(range.bounds)) {
        continue;
      }
      const group = FACINGS * range.pageNumber + facingOf(drawable, range.bounds, view);
      this.#found.set(view.matrix, MATRIX * count);
      this.#ids[count] = drawable.id;
      this.#groups[count] = group;
      this.#ranges[count] = range;
      this.#ends[group] = at(this.#ends, group) + 1;
      triangles += range.count / 3;
      count += 1;
    }
    this.#ranges.length = count;
    this.drawn.triangles = triangles;
    return count;
  }

  /** Puts the draws of a group behind each other. Within it they stay in their order. */
  #sort(count: number): void {
    const ends = this.#ends;
    let start = 0;
    for (let group = 0; group < ends.length; group += 1) {
      const length = at(ends, group);
      ends[group] = start;
      start += length;
    }
    for (let i = 0; i < count; i += 1) {
      const group = at(this.#groups, i);
      const place = at(ends, group);
      ends[group] = place + 1;
      const range = this.#ranges[i];
      this.#counts[place] = range?.count ?? 0;
      this.#offsets[place] = range?.byteOffset ?? 0;
      for (let number = 0; number < MATRIX; number += 1) {
        this.#matrices[FLOATS * place + number] = at(this.#found, MATRIX * i + number);
      }
      this.#numbers[FLOATS * place + MATRIX] = at(this.#ids, i);
    }
  }

  #upload(count: number): void {
    const gl = this.#gl;
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.#texture);
    const height = Math.ceil(count / PER_ROW);
    if (height > 0) {
      const width = PER_ROW * TEXELS;
      gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, width, height, gl.RGBA, gl.FLOAT, this.#matrices);
    }
  }

  #call(start: number, count: number, first: WebGLUniformLocation | null): void {
    const [gl, counts, offsets] = [this.#gl, this.#counts, this.#offsets];
    if (this.#multiDraw !== null) {
      gl.uniform1i(first, start);
      const type = gl.UNSIGNED_INT;
      this.#multiDraw.multiDrawElementsWEBGL(gl.TRIANGLES, counts, start, type, offsets, start, count);
      this.drawn.calls += 1;
      return;
    }
    for (let i = start; i < start + count; i += 1) {
      gl.uniform1i(first, i);
      gl.drawElements(gl.TRIANGLES, at(counts, i), gl.UNSIGNED_INT, at(offsets, i));
    }
    this.drawn.calls += count;
  }

  #reserve(count: number): void {
    if (count <= this.#capacity) {
      return;
    }
    const gl = this.#gl;
    const height = Math.ceil((count * 1.5) / PER_ROW);
    this.#capacity = height * PER_ROW;
    this.#found = new Float32Array(this.#capacity * MATRIX);
    this.#ids = new Uint32Array(this.#capacity);
    this.#groups = new Uint32Array(this.#capacity);
    this.#matrices = new Float32Array(this.#capacity * FLOATS);
    this.#numbers = new Uint32Array(this.#matrices.buffer);
    this.#counts = new Int32Array(this.#capacity);
    this.#offsets = new Int32Array(this.#capacity);
    gl.bindTexture(gl.TEXTURE_2D, this.#texture);
    const width = PER_ROW * TEXELS;
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, width, height, 0, gl.RGBA, gl.FLOAT, null);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
  }
}
