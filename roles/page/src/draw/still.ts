/**
 * The picture of an eye at rest: smooth, with lines at the edges of objects and at creases, and with dark
 * corners.
 *
 * It is the mean of several pictures, each shifted by a part of a pixel. It is refined step by step, and can
 * be shown after any step. Lines are painted over the picture, which stays the same. Where there is time, the
 * picture of a moving eye is one step of it.
 */

import { Program } from "./program.ts";
import { offsetOf, type Region } from "./region.ts";
import { STILL_FRAGMENT, WHOLE_VERTEX } from "./shaders.ts";

/** The number of pictures in the mean. */
export const STEPS = 8;

/** How one of them is drawn. */
export interface Step {
  /** Its share of the mean of those until it. */
  readonly share: number;
  /** Its shift, pixels. */
  readonly shift: readonly [number, number];
  /** How strong its lines are. */
  readonly strength: number;
  /** How far the places are turned that ambient occlusion looks at: turns. */
  readonly turn: number;
  /** Whether round surfaces look so: all have their normals. */
  readonly isSoft: boolean;
}

/** The only one of a moving eye, which has no time for more. */
export const IN_MOTION: Step = { share: 1, shift: [0, 0], strength: 1, turn: 0, isSoft: false };

/** Each one of an eye at rest. Lines fade in, unless they were there already. */
export function stepOf(step: number, haveLines: boolean): Step {
  return {
    share: 1 / (step + 1),
    shift: shiftOf(step),
    strength: haveLines ? 1 : strengthOf(step),
    turn: step / STEPS,
    isSoft: true,
  };
}

/** How strong lines are in each of these: they fade in, and have full strength in the mean. */
function strengthOf(step: number): number {
  return (2 * (step + 0.5)) / STEPS;
}

/** The shift of each picture in pixels, from -0.5 to 0.5: points of Halton's sequence. */
function shiftOf(step: number): readonly [number, number] {
  return [halton(step + 1, 2) - 0.5, halton(step + 1, 3) - 0.5];
}

/** Radical inverse (Halton 1960). */
function halton(index: number, base: number): number {
  let [left, share, sum] = [index, 1, 0];
  while (left > 0) {
    share /= base;
    sum += share * (left % base);
    left = Math.floor(left / base);
  }
  return sum;
}

export class Still {
  readonly #gl: WebGL2RenderingContext;
  readonly #program: Program;
  readonly #colour: WebGLTexture;
  readonly #colourFrame: WebGLFramebuffer;
  /** The opaque objects, and all objects if some are see-through. */
  readonly #objects: readonly [WebGLTexture, WebGLTexture];
  readonly #objectFrames: readonly [WebGLFramebuffer, WebGLFramebuffer];
  readonly #depth: WebGLRenderbuffer;
  readonly #mean: WebGLRenderbuffer;
  readonly #meanFrame: WebGLFramebuffer;
  #width = 0;
  #height = 0;

  constructor(gl: WebGL2RenderingContext) {
    this.#gl = gl;
    this.#program = new Program(gl, WHOLE_VERTEX, STILL_FRAGMENT);
    [this.#colour, this.#objects] = [gl.createTexture(), [gl.createTexture(), gl.createTexture()]];
    [this.#depth, this.#mean] = [gl.createRenderbuffer(), gl.createRenderbuffer()];
    this.#colourFrame = gl.createFramebuffer();
    this.#objectFrames = [gl.createFramebuffer(), gl.createFramebuffer()];
    this.#meanFrame = gl.createFramebuffer();
  }

  /** Takes the picture that is bound for reading. */
  takePicture(width: number, height: number): void {
    const gl = this.#gl;
    this.#fit(width, height);
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, this.#colourFrame);
    gl.blitFramebuffer(0, 0, width, height, 0, 0, width, height, gl.COLOR_BUFFER_BIT, gl.NEAREST);
  }

  /** The opaque objects, or all of them, are drawn next, into this. */
  beginObjects(which: "opaque" | "all"): void {
    const gl = this.#gl;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.#objectFrames[which === "opaque" ? 0 : 1]);
    gl.viewport(0, 0, this.#width, this.#height);
  }

  /**
   * Adds the picture of a region to the mean of the steps before. Takes half of the whole picture's width and
   * height at distance one.
   */
  add(
    { share, shift: [right, up], strength, turn }: Step,
    region: Region,
    [tanX, tanY]: readonly [number, number],
    hasSeeThrough: boolean,
  ): void {
    const gl = this.#gl;
    const [width, height] = [this.#width, this.#height];
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.#meanFrame);
    gl.viewport(0, 0, width, height);
    this.#program.use();
    for (const [unit, texture] of [this.#colour, ...this.#objects].entries()) {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, texture);
    }
    gl.uniform1i(this.#program.at("colours"), 0);
    gl.uniform1i(this.#program.at("objects"), 1);
    gl.uniform1i(this.#program.at("allObjects"), 2);
    gl.uniform1i(this.#program.at("hasSeeThrough"), hasSeeThrough ? 1 : 0);
    const { of, left, bottom } = region;
    const [across, above] = offsetOf(region);
    gl.uniform2f(this.#program.at("each"), (2 * tanX) / of.width, (2 * tanY) / of.height);
    gl.uniform2f(this.#program.at("offset"), right - across, up - above);
    gl.uniform2i(this.#program.at("corner"), left, bottom);
    gl.uniform1f(this.#program.at("wholeHeight"), of.height);
    gl.uniform1f(this.#program.at("strength"), strength);
    gl.uniform1f(this.#program.at("turn"), turn);
    gl.disable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendColor(0, 0, 0, share);
    gl.blendFunc(gl.CONSTANT_ALPHA, gl.ONE_MINUS_CONSTANT_ALPHA);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.disable(gl.BLEND);
    gl.activeTexture(gl.TEXTURE0);
  }

  /** Shows the mean on the canvas. */
  show(): void {
    const gl = this.#gl;
    const [width, height] = [this.#width, this.#height];
    gl.bindFramebuffer(gl.READ_FRAMEBUFFER, this.#meanFrame);
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, null);
    gl.blitFramebuffer(0, 0, width, height, 0, 0, width, height, gl.COLOR_BUFFER_BIT, gl.NEAREST);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  /** The mean: red, green, blue and alpha of each pixel, rows from below. */
  read(): Uint8Array {
    const gl = this.#gl;
    const pixels = new Uint8Array(4 * this.#width * this.#height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.#meanFrame);
    gl.readPixels(0, 0, this.#width, this.#height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    return pixels;
  }

  delete(): void {
    const gl = this.#gl;
    this.#program.delete();
    for (const texture of [this.#colour, ...this.#objects]) {
      gl.deleteTexture(texture);
    }
    for (const buffer of [this.#depth, this.#mean]) {
      gl.deleteRenderbuffer(buffer);
    }
    for (const frame of [this.#colourFrame, ...this.#objectFrames, this.#meanFrame]) {
      gl.deleteFramebuffer(frame);
    }
  }

  #fit(width: number, height: number): void {
    if (width === this.#width && height === this.#height) {
      return;
    }
    const gl = this.#gl;
    [this.#width, this.#height] = [width, height];
    const texture = (
      of: WebGLTexture,
      frame: WebGLFramebuffer,
      stored: number,
      format: number,
      type: number,
    ) => {
      gl.bindTexture(gl.TEXTURE_2D, of);
      gl.texImage2D(gl.TEXTURE_2D, 0, stored, width, height, 0, format, type, null);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
      gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, frame);
      gl.framebufferTexture2D(gl.DRAW_FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, of, 0);
    };
    texture(this.#colour, this.#colourFrame, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE);
    gl.bindRenderbuffer(gl.RENDERBUFFER, this.#depth);
    gl.renderbufferStorage(gl.RENDERBUFFER, gl.DEPTH_COMPONENT32F, width, height);
    for (const which of [0, 1] as const) {
      texture(this.#objects[which], this.#objectFrames[which], gl.RGBA32UI, gl.RGBA_INTEGER, gl.UNSIGNED_INT);
      gl.framebufferRenderbuffer(gl.DRAW_FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.RENDERBUFFER, this.#depth);
    }
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, this.#meanFrame);
    gl.bindRenderbuffer(gl.RENDERBUFFER, this.#mean);
    gl.renderbufferStorage(gl.RENDERBUFFER, gl.RGBA8, width, height);
    gl.framebufferRenderbuffer(gl.DRAW_FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.RENDERBUFFER, this.#mean);
  }
}
