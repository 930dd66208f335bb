/** Draws all drawables of a picture in few calls: their matrices are in a texture, indexed by draw number. */

import { isOfSolids } from "../proto/sides.ts";
import type { GeometryArena } from "./arena.ts";
import { BOTH, FACINGS, MIRRORED } from "./facing.ts";
import type { Features } from "./features.ts";
import type { Drawable, Look } from "./model.ts";
import { DrawOrder } from "./order.ts";
import type { Program } from "./program.ts";
import { PER_ROW, TEXELS } from "./shaders.ts";
import { at, MATRIX, type View } from "./view.ts";

/** Marks a highlighted drawable, beside its colour. */
const HIGHLIGHTED = 1 << 25;
/** The initial capacity for drawables. */
const FIRST = 4096;
const FLOATS = 4 * TEXELS;

/** The cost of a picture. */
export interface Drawn {
  /** Draw calls. */
  calls: number;
  /** Drawables in the frustum with geometry on the device. */
  drawables: number;
  triangles: number;
}

/** Allocates no memory for a picture with no more drawables than an earlier one. */
export class Batch {
  readonly #gl: WebGL2RenderingContext;
  readonly #multiDraw: WEBGL_multi_draw | null;
  readonly #texture: WebGLTexture;
  readonly #order = new DrawOrder();
  #capacity = 0;
  /** For each draw: its matrix, number, colour, solid flag, object, range of indices, and kind. */
  #matrices = new Float32Array(0);
  #numbers = new Uint32Array(0);
  #counts = new Int32Array(0);
  #offsets = new Int32Array(0);
  #kinds = new Uint32Array(0);
  readonly drawn: Drawn = { calls: 0, drawables: 0, triangles: 0 };

  constructor(gl: WebGL2RenderingContext, { multiDraw }: Features) {
    [this.#gl, this.#multiDraw] = [gl, multiDraw];
    this.#texture = gl.createTexture();
    this.#reserve(FIRST);
  }

  /**
   * Draws, with `program`, the drawables in view with geometry in `arena`, in the order of all displays: of
   * coincident surfaces the first one is visible. Each run of draws of one kind is a call.
   */
  draw(view: View, drawables: readonly Drawable[], arena: GeometryArena, program: Program, look: Look): void {
    this.#reserve(drawables.length);
    this.#order.sort(view, drawables);
    const count = this.#find(view, drawables, arena, look);
    this.#upload(count);
    this.drawn.calls = 0;
    this.drawn.drawables = count;
    const number = program.at("first");
    let [first, page] = [0, -1];
    for (let next = 1; next <= count; next += 1) {
      const kind = at(this.#kinds, first);
      if (next < count && at(this.#kinds, next) === kind) {
        continue;
      }
      if (page !== Math.floor(kind / FACINGS)) {
        page = Math.floor(kind / FACINGS);
        arena.pages[page]?.bind();
      }
      this.#face(kind % FACINGS);
      this.#call(first, next - first, number);
      first = next;
    }
    this.#face(BOTH);
    this.#gl.bindVertexArray(null);
  }

  /** Finds the drawables in view. One call can draw one kind: a page, and the visible sides of triangles. */
  #find(view: View, drawables: readonly Drawable[], arena: GeometryArena, look: Look): number {
    let [count, triangles] = [0, 0];
    for (let before = 0; before < drawables.length; before += 1) {
      const place = this.#order.place(before);
      const drawable = drawables[place];
      const range = drawable && arena.range(drawable.geometry);
      if (drawable === undefined || range === undefined) {
        continue;
      }
      view.place(drawable);
      if (!view.sees(range.bounds)) {
        continue;
      }
      for (let number = 0; number < MATRIX; number += 1) {
        this.#matrices[FLOATS * count + number] = at(view.matrix, number);
      }
      this.#numbers[FLOATS * count + MATRIX] = drawable.id;
      // Of several objects in one the first counts.
      const highlight = look.highlighted.has(drawable.object) ? HIGHLIGHTED : 0;
      const colour = look.colours?.codeOf(drawable.object) ?? 0;
      this.#numbers[FLOATS * count + MATRIX + 1] = highlight | colour;
      this.#matrices[FLOATS * count + MATRIX + 2] = isOfSolids(drawable.sides) ? 1 : 0;
      this.#numbers[FLOATS * count + MATRIX + 3] = drawable.object;
      this.#counts[count] = range.count;
      this.#offsets[count] = range.byteOffset;
      // A solid that is cut open shows its inside.
      const facing = look.sections.length > 0 ? BOTH : this.#order.facing(place);
      this.#kinds[count] = FACINGS * range.pageNumber + facing;
      triangles += range.count / 3;
      count += 1;
    }
    this.drawn.triangles = triangles;
    return count;
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
    const gl = this.#gl;
    const [counts, offsets] = [this.#counts, this.#offsets];
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
    this.#matrices = new Float32Array(this.#capacity * FLOATS);
    this.#numbers = new Uint32Array(this.#matrices.buffer);
    this.#counts = new Int32Array(this.#capacity);
    this.#offsets = new Int32Array(this.#capacity);
    this.#kinds = new Uint32Array(this.#capacity);
    gl.bindTexture(gl.TEXTURE_2D, this.#texture);
    const width = PER_ROW * TEXELS;
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, width, height, 0, gl.RGBA, gl.FLOAT, null);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
  }
}
