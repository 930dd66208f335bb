/** Runs in the browser under test: gives tests the renderer, and pictures as numbers. */

import { ObjectColours } from "../src/draw/colours.ts";
import type { Camera, Drawable, Look, Mesh } from "../src/draw/model.ts";
import { cutOut, tilesOf } from "../src/draw/region.ts";
import { NOTHING, Renderer, type RendererOptions } from "../src/draw/renderer.ts";
import { UNFOLDED } from "../src/draw/shaders.ts";
import { loadSmoother } from "../src/draw/smoothing.ts";
import { ObjectSet } from "../src/proto/objectSet.ts";
import { BOTH_SIDES, FRONT_SIDE } from "../src/proto/sides.ts";
import * as scene from "./drawScene.ts";

/** A renderer on a canvas of its own. */
export class Stage {
  readonly canvas: HTMLCanvasElement;
  readonly renderer: Renderer;
  readonly gl: WebGL2RenderingContext;
  /** The renderer's events. */
  readonly said: string[] = [];

  constructor(width: number, height: number, options: RendererOptions = {}) {
    this.canvas = document.createElement("canvas");
    document.body.append(this.canvas);
    this.renderer = new Renderer(this.canvas, {
      ...options,
      onLost: () => this.said.push("lost"),
      onRestored: () => this.said.push("restored"),
    });
    [this.canvas.width, this.canvas.height] = [width, height];
    const gl = this.canvas.getContext("webgl2");
    if (gl === null) {
      throw new Error("the renderer's context is gone");
    }
    this.gl = gl;
  }

  /** Sets meshes, the first as the piece 0. */
  set(...meshes: readonly Mesh[]): void {
    for (const [number, mesh] of meshes.entries()) {
      this.renderer.setPiece(number, mesh);
    }
  }

  /** The numbers of drawables from above, row by row; -1 is nothing. */
  items(camera: Camera, drawables: readonly Drawable[]): number[][] {
    const { width, height } = this.canvas;
    const items = Array.from(this.renderer.items(camera, drawables), (id) => (id === NOTHING ? -1 : id));
    return Array.from({ length: height }, (_, row) => {
      const below = height - 1 - row;
      return items.slice(below * width, (below + 1) * width);
    });
  }

  /** The drawables visible at any pixel, in order. */
  seen(camera: Camera, drawables: readonly Drawable[]): number[] {
    return [...new Set(this.items(camera, drawables).flat())].filter((id) => id >= 0).sort((a, b) => a - b);
  }

  /** The picture: red, green, blue and alpha of each pixel, rows from below. */
  picture(camera: Camera, drawables: readonly Drawable[]): Uint8Array {
    const { width, height } = this.canvas;
    this.renderer.draw(camera, drawables);
    const pixels = new Uint8Array(4 * width * height);
    this.gl.readPixels(0, 0, width, height, this.gl.RGBA, this.gl.UNSIGNED_BYTE, pixels);
    return pixels;
  }

  /** The colour of a pixel of the picture, counted from the upper left. */
  colour(camera: Camera, drawables: readonly Drawable[], x: number, y: number): number[] {
    const at = 4 * ((this.canvas.height - 1 - y) * this.canvas.width + x);
    return [...this.picture(camera, drawables).slice(at, at + 3)];
  }

  /** Fails if the device has reported an error. */
  end(): void {
    const error = this.gl.getError();
    this.canvas.remove();
    this.gl.getExtension("WEBGL_lose_context")?.loseContext();
    if (error !== this.gl.NO_ERROR) {
      throw new Error(`the device says ${error}`);
    }
  }
}

/**
 * The difference between the picture at rest and the same picture drawn in tiles. It is the share of the
 * pixels that differ at all, and of those with a tone that is off by more than a fifth. The number of colours
 * is given as well.
 */
async function tileDifference(
  stage: Stage,
  camera: Camera,
  drawables: readonly Drawable[],
  look: Look,
  side: number,
): Promise<{ tiles: number; differing: number; wrong: number; colours: number }> {
  const { renderer, gl, canvas } = stage;
  const { width, height } = canvas;
  const tiled = new Uint8Array(4 * width * height);
  const tiles = tilesOf({ width, height }, side);
  for (const tile of tiles) {
    const pixels = (await renderer.drawRegion(camera, drawables, look, tile.drawn)) ?? new Uint8Array(0);
    const rows = cutOut(tile, pixels);
    for (let row = 0; row < tile.height; row += 1) {
      // From above to below.
      const to = tile.bottom + tile.height - 1 - row;
      const from = rows.subarray(4 * row * tile.width, 4 * (row + 1) * tile.width);
      tiled.set(from, 4 * (to * width + tile.left));
    }
  }
  renderer.draw(camera, drawables, look);
  while (renderer.refine()) {}
  const whole = new Uint8Array(4 * width * height);
  gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, whole);
  let [differing, wrong] = [0, 0];
  const colours = new Set<number>();
  for (let y = 0; y < height; y += 1) {
    for (let x = 0; x < width; x += 1) {
      const at = 4 * (y * width + x);
      const tones = [0, 1, 2].map((of) => Math.abs((whole[at + of] ?? 0) - (tiled[at + of] ?? 0)));
      differing += Math.max(...tones) > 2 ? 1 : 0;
      wrong += Math.max(...tones) > 51 ? 1 : 0;
      colours.add(((whole[at] ?? 0) << 16) | ((whole[at + 1] ?? 0) << 8) | (whole[at + 2] ?? 0));
    }
  }
  const all = width * height;
  return { tiles: tiles.length, differing: differing / all, wrong: wrong / all, colours: colours.size };
}

/**
 * The share of the pixels of a rectangle (left, top, width, height) of the picture at rest that are darker
 * than nine tenths of their median: those covered by lines.
 */
function darkness(
  stage: Stage,
  camera: Camera,
  drawables: readonly Drawable[],
  [left, top, width, height]: readonly [number, number, number, number],
  look?: Look,
): number {
  const { renderer, gl, canvas } = stage;
  renderer.draw(camera, drawables, look);
  while (renderer.refine()) {}
  const pixels = new Uint8Array(4 * width * height);
  gl.readPixels(left, canvas.height - top - height, width, height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  const tones = pixels.filter((_, at) => at % 4 === 1);
  const median = tones.slice().sort()[tones.length >> 1] ?? 0;
  return tones.filter((tone) => tone < 0.9 * median).length / tones.length;
}

/** The shaders' decoding of folded normals, three numbers each. */
function unfolded(normals: readonly (readonly [number, number])[]): Float32Array {
  const gl = document.createElement("canvas").getContext("webgl2");
  if (gl === null) {
    throw new Error("there is no context");
  }
  const program = gl.createProgram();
  const source = `#version 300 es
layout(location = 0) in vec2 folded;
out vec3 normal;
${UNFOLDED}
void main() { normal = unfolded(folded); }`;
  for (const [kind, text] of [
    [gl.VERTEX_SHADER, source],
    [gl.FRAGMENT_SHADER, "#version 300 es\nvoid main() {}"],
  ] as const) {
    const shader = gl.createShader(kind);
    if (shader !== null) {
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
  }
  gl.transformFeedbackVaryings(program, ["normal"], gl.SEPARATE_ATTRIBS);
  gl.linkProgram(program);
  gl.useProgram(program);
  gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ARRAY_BUFFER, Int16Array.from(normals.flat()), gl.STATIC_DRAW);
  gl.enableVertexAttribArray(0);
  gl.vertexAttribPointer(0, 2, gl.SHORT, true, 0, 0);
  gl.bindBuffer(gl.ARRAY_BUFFER, null);
  gl.bindBufferBase(gl.TRANSFORM_FEEDBACK_BUFFER, 0, gl.createBuffer());
  const numbers = new Float32Array(3 * normals.length);
  gl.bufferData(gl.TRANSFORM_FEEDBACK_BUFFER, numbers.byteLength, gl.DYNAMIC_READ);
  gl.enable(gl.RASTERIZER_DISCARD);
  gl.beginTransformFeedback(gl.POINTS);
  gl.drawArrays(gl.POINTS, 0, normals.length);
  gl.endTransformFeedback();
  gl.getBufferSubData(gl.TRANSFORM_FEEDBACK_BUFFER, 0, numbers);
  return numbers;
}

/** Made available to tests in the page. */
const harness = {
  Stage,
  NOTHING,
  darkness,
  tileDifference,
  unfolded,
  ObjectColours,
  ObjectSet,
  FRONT_SIDE,
  BOTH_SIDES,
  ...scene,
};

declare global {
  interface Window {
    readonly draw: typeof harness;
  }
}

// All of it is bundled, so the code is there before the page is.
void loadSmoother().then(() => Object.assign(window, { draw: harness }));
