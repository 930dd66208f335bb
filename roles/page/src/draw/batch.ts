/** All drawables of a picture as few calls: their matrices lie in a texture, by the number of the draw. */

import type { Camera } from "../proto/camera.ts";
import type { DrawableRecord } from "../proto/records.ts";
import type { Arena } from "./arena.ts";
import { DrawOrder } from "./order.ts";
import { PER_ROW, TEXELS } from "./shaders.ts";
import { worldToCamera, writeRows } from "./view.ts";

/** Drawables that there is room for at first. */
const FIRST = 4096;
const FLOATS = 4 * TEXELS;

export class Batch {
  readonly #gl: WebGL2RenderingContext;
  readonly #multiDraw: WEBGL_multi_draw | null;
  readonly #texture: WebGLTexture;
  #capacity = 0;
  #matrices = new Float32Array(0);
  #numbers = new Uint32Array(0);
  #counts = new Int32Array(0);
  #offsets = new Int32Array(0);
  readonly #order = new DrawOrder();
  #drawn = { calls: 0, drawables: 0, triangles: 0 };

  constructor(gl: WebGL2RenderingContext, multiDraw: WEBGL_multi_draw | null) {
    [this.#gl, this.#multiDraw] = [gl, multiDraw];
    this.#texture = gl.createTexture();
    this.#reserve(FIRST);
  }

  get drawn(): { readonly calls: number; readonly drawables: number; readonly triangles: number } {
    return this.#drawn;
  }

  /**
   * Draws what has its geometry in `arena`, in the order of all displays: of surfaces in one place the first
   * one shows. Each run of drawables that show the same sides is a call.
   */
  draw(
    camera: Camera,
    drawables: readonly DrawableRecord[],
    arena: Arena,
    number: WebGLUniformLocation | null,
  ): void {
    const gl = this.#gl;
    this.#reserve(drawables.length);
    const rows = worldToCamera(camera.orientation);
    const runs: { sides: number; count: number }[] = [];
    let [count, triangles] = [0, 0];
    for (const at of this.#order.sort(camera.eye, drawables)) {
      const drawable = drawables[at];
      const range = drawable === undefined ? undefined : arena.range(drawable.geometry);
      if (drawable === undefined || range === undefined) {
        continue;
      }
      writeRows(this.#matrices, FLOATS * count, rows, camera.eye, drawable);
      this.#numbers[FLOATS * count + 12] = drawable.id;
      this.#counts[count] = range.count;
      this.#offsets[count] = range.byteOffset;
      triangles += range.count / 3;
      count += 1;
      const run = runs.at(-1);
      if (run?.sides === drawable.sides) {
        run.count += 1;
      } else {
        runs.push({ sides: drawable.sides, count: 1 });
      }
    }
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.#texture);
    const height = Math.ceil(count / PER_ROW);
    if (height > 0) {
      const width = PER_ROW * TEXELS;
      gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, width, height, gl.RGBA, gl.FLOAT, this.#matrices);
    }
    let [calls, first] = [0, 0];
    for (const { sides, count } of runs) {
      if (sides === 0) {
        gl.disable(gl.CULL_FACE);
      } else {
        gl.enable(gl.CULL_FACE);
      }
      calls += this.#call(first, count, number);
      first += count;
    }
    gl.disable(gl.CULL_FACE);
    this.#drawn = { calls, drawables: count, triangles };
  }

  #call(first: number, count: number, number: WebGLUniformLocation | null): number {
    const gl = this.#gl;
    if (count === 0) {
      return 0;
    }
    if (this.#multiDraw !== null) {
      gl.uniform1i(number, first);
      this.#multiDraw.multiDrawElementsWEBGL(
        gl.TRIANGLES,
        this.#counts,
        first,
        gl.UNSIGNED_INT,
        this.#offsets,
        first,
        count,
      );
      return 1;
    }
    for (let i = first; i < first + count; i += 1) {
      gl.uniform1i(number, i);
      gl.drawElements(gl.TRIANGLES, this.#counts[i] ?? 0, gl.UNSIGNED_INT, this.#offsets[i] ?? 0);
    }
    return count;
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
    gl.bindTexture(gl.TEXTURE_2D, this.#texture);
    const width = PER_ROW * TEXELS;
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, width, height, 0, gl.RGBA, gl.FLOAT, null);
    for (const wish of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) {
      gl.texParameteri(gl.TEXTURE_2D, wish, gl.NEAREST);
    }
  }
}
