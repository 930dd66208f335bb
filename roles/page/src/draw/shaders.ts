/** The shaders. Positions are relative to the eye, in camera space, before they reach the device. */

/** Texels of a drawable: three rows of its matrix, and its number. */
export const TEXELS = 4;
/** Drawables in a row of the texture that holds them. */
export const PER_ROW = 256;

/** How the number of a draw is known. */
export type DrawNumber = "multi-draw" | "uniform";
/** What depth is: near over distance, from 0 to 1; or the usual, from -1 to 1. */
export type Depth = "reversed" | "standard";

function head(number: DrawNumber, depth: Depth): string {
  const extension = number === "multi-draw" ? "#extension GL_ANGLE_multi_draw : require" : "";
  const draw =
    number === "multi-draw" ? "uniform int first;\n#define DRAW (first + gl_DrawID)" : "uniform int DRAW;";
  const z = depth === "reversed" ? "near" : "-view.z - 2.0 * near";
  return `#version 300 es
${extension}
precision highp float;
precision highp int;
precision highp sampler2D;
${draw}
uniform sampler2D drawables;
uniform vec2 scale;
uniform float near;
layout(location = 0) in vec3 local;
layout(location = 1) in vec4 colour;
layout(location = 2) in vec2 folded;

vec4 texel(int i) {
  return texelFetch(drawables, ivec2((DRAW % ${PER_ROW}) * ${TEXELS} + i, DRAW / ${PER_ROW}), 0);
}

vec4 clip(vec3 view) {
  return vec4(view.xy * scale, ${z}, -view.z);
}
`;
}

/** Shades by a sky, a light at the eye and a key light; a triangle has one normal. */
export function pictureVertex(number: DrawNumber, depth: Depth): string {
  return `${head(number, depth)}
uniform vec3 up;
uniform vec3 key;
flat out vec3 tone;

vec3 unfolded(vec2 f) {
  float z = 1.0 - abs(f.x) - abs(f.y);
  float under = max(-z, 0.0);
  return vec3(f.x + (f.x >= 0.0 ? -under : under), f.y + (f.y >= 0.0 ? -under : under), z);
}

void main() {
  vec4 x = texel(0), y = texel(1), z = texel(2);
  vec4 p = vec4(local, 1.0);
  vec3 view = vec3(dot(x, p), dot(y, p), dot(z, p));
  vec3 n = unfolded(folded);
  // Cofactors keep a normal at right angles to its plane under any scale.
  vec3 normal = vec3(
    dot(cross(y.xyz, z.xyz), n), dot(cross(z.xyz, x.xyz), n), dot(cross(x.xyz, y.xyz), n));
  normal *= inversesqrt(max(dot(normal, normal), 1e-36));
  normal = dot(normal, view) > 0.0 ? -normal : normal;
  float light = 0.16 + 0.26 * (0.5 + 0.5 * dot(normal, up)) + 0.26 * dot(normal, -normalize(view))
    + 0.34 * max(dot(normal, key), 0.0);
  // Plants come in pure red and green: they shout less with a little grey in them.
  float grey = dot(colour.rgb, vec3(0.299, 0.587, 0.114));
  vec3 calm = mix(vec3(grey), colour.rgb, 0.82) * 0.93 + 0.03;
  tone = calm * sqrt(light);
  gl_Position = clip(view);
}`;
}

export const PICTURE_FRAGMENT = `#version 300 es
precision mediump float;
flat in vec3 tone;
out vec4 pixel;
void main() { pixel = vec4(tone, 1.0); }`;

/** The number of the drawable at each pixel. */
export function itemVertex(number: DrawNumber, depth: Depth): string {
  return `${head(number, depth)}
flat out uint item;
void main() {
  vec4 p = vec4(local, 1.0);
  item = floatBitsToUint(texel(3).x);
  gl_Position = clip(vec3(dot(texel(0), p), dot(texel(1), p), dot(texel(2), p)));
}`;
}

export const ITEM_FRAGMENT = `#version 300 es
precision highp float;
precision highp int;
flat in highp uint item;
out highp uint pixel;
void main() { pixel = item; }`;

/** Sky above the horizon, ground below. */
export const BACKGROUND_VERTEX = `#version 300 es
uniform vec2 ray;
out vec3 direction;
void main() {
  vec2 corner = vec2(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0);
  direction = vec3(corner * ray, -1.0);
  gl_Position = vec4(corner, 0.0, 1.0);
}`;

export const BACKGROUND_FRAGMENT = `#version 300 es
precision highp float;
in vec3 direction;
uniform vec3 up;
out vec4 pixel;
void main() {
  float height = dot(normalize(direction), up);
  vec3 sky = mix(vec3(0.90, 0.93, 0.95), vec3(0.62, 0.74, 0.86), sqrt(clamp(height, 0.0, 1.0)));
  vec3 ground = mix(vec3(0.80, 0.81, 0.80), vec3(0.60, 0.61, 0.60), sqrt(clamp(-height, 0.0, 1.0)));
  pixel = vec4(mix(ground, sky, smoothstep(-0.012, 0.012, height)), 1.0);
}`;
