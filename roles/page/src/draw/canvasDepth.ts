/**
 * Whether pictures can be drawn onto the canvas itself, without a copy.
 *
 * A copy of a picture of 1024 by 1024 pixels takes the processor 17 ms. But most devices give a canvas a
 * 24-bit fixed-point depth buffer, which is too coarse far away.
 */

import { featuresOf } from "./features.ts";
import { Program } from "./program.ts";

/** Depths that only a floating-point depth buffer distinguishes. */
const NEAR = 2e-12;
const FAR = 1e-12;

/** A triangle over the whole picture. */
const VERTEX = `#version 300 es
uniform float depth;
void main() {
  gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, depth, 1.0);
}`;
const FRAGMENT = `#version 300 es
precision mediump float;
uniform float tone;
out vec4 pixel;
void main() { pixel = vec4(tone); }`;

/**
 * Tests it on a temporary canvas. With several samples a pixel, pictures are drawn to a target first. By
 * default only a software renderer draws one sample.
 */
export function canDrawOnCanvas(samples: number | undefined, extensions: boolean | undefined): boolean {
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [1, 1];
  const gl = canvas.getContext("webgl2", { antialias: false, depth: true });
  if (gl === null) {
    return false;
  }
  const { depth, isSoftware } = featuresOf(gl, extensions);
  const isSingle = samples === 1 || (samples === undefined && isSoftware);
  // Standard depth is as coarse far away in a 32-bit target.
  const can = isSingle && (depth === "standard" || hasFineDepth(gl));
  gl.getExtension("WEBGL_lose_context")?.loseContext();
  return can;
}

/** Whether the nearer of two reversed depths wins if drawn last. */
function hasFineDepth(gl: WebGL2RenderingContext): boolean {
  const program = new Program(gl, VERTEX, FRAGMENT);
  program.use();
  gl.enable(gl.DEPTH_TEST);
  gl.depthFunc(gl.GREATER);
  gl.clearDepth(0);
  gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  for (const depth of [FAR, NEAR]) {
    gl.uniform1f(program.at("depth"), depth);
    gl.uniform1f(program.at("tone"), depth === NEAR ? 1 : 0);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }
  const pixel = new Uint8Array(4);
  gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
  return pixel[0] === 255;
}
