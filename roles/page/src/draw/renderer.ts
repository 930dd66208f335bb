/** Draws drawables out of pieces of geometry that come and go. */

import type { Camera } from "../proto/camera.ts";
import type { Piece } from "../proto/piece.ts";
import type { DrawableRecord } from "../proto/records.ts";
import { Arena } from "./arena.ts";
import { Batch } from "./batch.ts";
import {
  BACKGROUND_FRAGMENT,
  BACKGROUND_VERTEX,
  type Depth,
  type DrawNumber,
  ITEM_FRAGMENT,
  itemVertex,
  PICTURE_FRAGMENT,
  pictureVertex,
} from "./shaders.ts";
import { Target } from "./target.ts";
import { turned, worldToCamera } from "./view.ts";

/** Towards the key light, in the world. No two walls of a right-angled building face it alike. */
const KEY = [0.48, 0.8, 0.36] as const;
const UP = [0, 1, 0] as const;
/** No drawable has this number. */
export const NOTHING = 0xffff_ffff;

/** EXT_clip_control, which the library of types does not have. */
interface ClipControl {
  clipControlEXT(origin: number, depth: number): void;
  readonly LOWER_LEFT_EXT: number;
  readonly ZERO_TO_ONE_EXT: number;
}

export interface RendererOptions {
  /** Samples a pixel; 1 draws without antialiasing. By default 4 on a graphics card, and 1 without one. */
  readonly samples?: number;
}

export class Renderer {
  readonly #gl: WebGL2RenderingContext;
  readonly #arena: Arena;
  readonly #batch: Batch;
  readonly #picture: WebGLProgram;
  readonly #item: WebGLProgram;
  readonly #background: WebGLProgram;
  readonly #target: Target;
  readonly depth: Depth;
  readonly drawNumber: DrawNumber;
  readonly device: string;
  #items: Target | undefined;

  /** Throws where the browser has no WebGL2. */
  constructor(canvas: HTMLCanvasElement, options: RendererOptions = {}) {
    const gl = canvas.getContext("webgl2", {
      antialias: false,
      depth: false,
      powerPreference: "high-performance",
    });
    if (gl === null) {
      throw new Error("this browser has no WebGL2, which drawing needs");
    }
    this.#gl = gl;
    const clip = gl.getExtension("EXT_clip_control") as ClipControl | null;
    clip?.clipControlEXT(clip.LOWER_LEFT_EXT, clip.ZERO_TO_ONE_EXT);
    this.depth = clip === null ? "standard" : "reversed";
    const multiDraw = gl.getExtension("WEBGL_multi_draw");
    this.drawNumber = multiDraw === null ? "uniform" : "multi-draw";
    const info = gl.getExtension("WEBGL_debug_renderer_info");
    this.device = String(gl.getParameter(info?.UNMASKED_RENDERER_WEBGL ?? gl.RENDERER));
    const isSoftware = /swiftshader|llvmpipe|software/i.test(this.device);
    const most = gl.getParameter(gl.MAX_SAMPLES) as number;
    this.#target = new Target(gl, "picture", Math.min(options.samples ?? (isSoftware ? 1 : 4), most));
    this.#picture = program(gl, pictureVertex(this.drawNumber, this.depth), PICTURE_FRAGMENT);
    this.#item = program(gl, itemVertex(this.drawNumber, this.depth), ITEM_FRAGMENT);
    this.#background = program(gl, BACKGROUND_VERTEX, BACKGROUND_FRAGMENT);
    this.#arena = new Arena(gl);
    this.#batch = new Batch(gl, multiDraw);
  }

  /** Bytes of geometry on the device. */
  get bytes(): number {
    return this.#arena.bytes;
  }

  /** What the last picture took: calls, drawables, triangles. */
  get drawn(): { readonly calls: number; readonly drawables: number; readonly triangles: number } {
    return this.#batch.drawn;
  }

  setPiece(number: number, piece: Piece): void {
    this.#arena.set(number, piece);
  }

  dropPiece(number: number): void {
    this.#arena.drop(number);
  }

  /** Draws what of `drawables` has its geometry here, onto the canvas. */
  draw(camera: Camera, drawables: readonly DrawableRecord[]): void {
    const gl = this.#gl;
    const { width, height } = gl.canvas;
    this.#target.begin(width, height);
    const rows = worldToCamera(camera.orientation);
    const ray = [(camera.tanHalfFov * width) / height, camera.tanHalfFov] as const;
    gl.disable(gl.DEPTH_TEST);
    gl.useProgram(this.#background);
    gl.uniform2f(this.#at(this.#background, "ray"), ...ray);
    gl.uniform3f(this.#at(this.#background, "up"), ...turned(rows, UP));
    gl.bindVertexArray(null);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.useProgram(this.#picture);
    gl.uniform3f(this.#at(this.#picture, "up"), ...turned(rows, UP));
    gl.uniform3f(this.#at(this.#picture, "key"), ...turned(rows, KEY));
    this.#drawables(this.#picture, camera, drawables, ray);
    this.#target.show();
  }

  /** The number of the drawable at each pixel, rows from below; `NOTHING` where there is none. */
  items(camera: Camera, drawables: readonly DrawableRecord[]): Uint32Array {
    const gl = this.#gl;
    const { width, height } = gl.canvas;
    this.#items ??= new Target(gl, "items", 1);
    this.#items.begin(width, height);
    gl.useProgram(this.#item);
    this.#drawables(this.#item, camera, drawables, [(camera.tanHalfFov * width) / height, camera.tanHalfFov]);
    return this.#items.read();
  }

  #drawables(
    program: WebGLProgram,
    camera: Camera,
    drawables: readonly DrawableRecord[],
    ray: readonly [number, number],
  ): void {
    const gl = this.#gl;
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(this.depth === "reversed" ? gl.GREATER : gl.LESS);
    gl.clearDepth(this.depth === "reversed" ? 0 : 1);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    gl.uniform2f(this.#at(program, "scale"), 1 / ray[0], 1 / ray[1]);
    gl.uniform1f(this.#at(program, "near"), camera.near);
    const number = this.#at(program, this.drawNumber === "multi-draw" ? "first" : "DRAW");
    gl.bindVertexArray(this.#arena.vertexArray);
    this.#batch.draw(camera, drawables, this.#arena, number);
    gl.bindVertexArray(null);
  }

  #at(program: WebGLProgram, name: string): WebGLUniformLocation | null {
    return this.#gl.getUniformLocation(program, name);
  }
}

function program(gl: WebGL2RenderingContext, vertex: string, fragment: string): WebGLProgram {
  const made = gl.createProgram();
  for (const [kind, source] of [
    [gl.VERTEX_SHADER, vertex],
    [gl.FRAGMENT_SHADER, fragment],
  ] as const) {
    const shader = gl.createShader(kind);
    if (shader !== null) {
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(made, shader);
    }
  }
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS) && !gl.isContextLost()) {
    const logs = (gl.getAttachedShaders(made) ?? []).map((shader) => gl.getShaderInfoLog(shader));
    throw new Error(`a shader cannot be used: ${gl.getProgramInfoLog(made)} ${logs.join(" ")}`);
  }
  return made;
}
