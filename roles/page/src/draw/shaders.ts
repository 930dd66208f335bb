/** The shaders. Positions are relative to the eye, in camera space, before they reach the device. */

import { MOST_PLANES } from "./cut.ts";
import type { Depth, DrawNumber } from "./features.ts";
import { COLOUR, NORMAL, POSITION } from "./page.ts";

/** Texels of a drawable: three rows of its matrix, and one with its number, whether it is
 * highlighted, whether it is a solid, and the number of its object. */
export const TEXELS = 4;
/** Drawables in a row of the texture that holds them. */
export const PER_ROW = 256;

/** What all vertex shaders share, so that a triangle covers the same samples at the same depth in each. */
function head(number: DrawNumber, depth: Depth): string {
  const extension = number === "multi-draw" ? "#extension GL_ANGLE_multi_draw : require" : "";
  const draw = number === "multi-draw" ? "(first + gl_DrawID)" : "first";
  // Depth is this over the distance.
  const z = depth === "reversed" ? "near" : "-view.z - 2.0 * near";
  return `#version 300 es
${extension}
precision highp float;
precision highp int;
precision highp sampler2D;
invariant gl_Position;
uniform int first;
uniform sampler2D drawables;
uniform vec2 scale;
uniform float near;
// By how much the picture is shifted.
uniform vec2 shift;
layout(location = ${POSITION}) in vec3 local;
layout(location = ${COLOUR}) in vec4 colour;
layout(location = ${NORMAL}) in vec2 folded;

vec4 texel(int i) {
  int draw = ${draw};
  return texelFetch(drawables, ivec2((draw % ${PER_ROW}) * ${TEXELS} + i, draw / ${PER_ROW}), 0);
}

vec4 clip(vec3 view) {
  return vec4(view.xy * scale - shift * view.z, ${z}, -view.z);
}
`;
}

/**
 * What sections need of a vertex: where it is in camera space, and whether it shows the inside of a solid.
 */
const CUT_OUT = `
out vec3 place;
flat out float isInside;`;

/** Ends where a section cuts: see `cut.ts`. */
const CUT = `
uniform vec4 planes[${MOST_PLANES}];
uniform int planeCount;
in vec3 place;
flat in float isInside;
void cut() {
  for (int i = 0; i < planeCount; i += 1) {
    if (dot(planes[i].xyz, place) + planes[i].w > 0.0) {
      discard;
    }
  }
}`;

/** A normal that is scaled until the sizes of its coordinates add up to 1, from two of these. */
export const UNFOLDED = `
vec3 unfolded(vec2 f) {
  float z = 1.0 - abs(f.x) - abs(f.y);
  float under = max(-z, 0.0);
  return vec3(f.x + (f.x >= 0.0 ? -under : under), f.y + (f.y >= 0.0 ? -under : under), z);
}`;

/**
 * Shades by a sky, which is brighter than the ground, and by a key light over the shoulder of who looks.
 *
 * A triangle has one normal, and the lights are the same all over it. So what is flat looks flat, however it
 * was cut into triangles.
 */
export function pictureVertex(number: DrawNumber, depth: Depth, isCut = false): string {
  return `${head(number, depth)}
uniform vec3 up;
flat out vec3 tone;
${isCut ? CUT_OUT : ""}
const vec3 KEY = vec3(0.36, 0.48, 0.80);
const vec3 HIGHLIGHT = vec3(1.0, 0.55, 0.10);
${UNFOLDED}

void main() {
  vec4 x = texel(0), y = texel(1), z = texel(2);
  vec4 p = vec4(local, 1.0);
  vec3 view = vec3(dot(x, p), dot(y, p), dot(z, p));
  vec3 n = unfolded(folded);
  // Cofactors keep a normal at right angles to its plane under any scale.
  vec3 normal = vec3(
    dot(cross(y.xyz, z.xyz), n), dot(cross(z.xyz, x.xyz), n), dot(cross(x.xyz, y.xyz), n));
  normal *= inversesqrt(max(dot(normal, normal), 1e-36));
  bool isBack = dot(normal, view) * dot(cross(x.xyz, y.xyz), z.xyz) > 0.0;
  // Both sides of a triangle are lit alike, whatever the winding and even in a mirror.
  normal = dot(normal, view) > 0.0 ? -normal : normal;
  float light = 0.17 + 0.27 * (0.5 + 0.5 * dot(normal, up)) + 0.56 * max(dot(normal, KEY), 0.0);
  // Plants come in pure red and green: they shout less with a little grey in them.
  float grey = dot(colour.rgb, vec3(0.299, 0.587, 0.114));
  vec3 calm = mix(vec3(grey), colour.rgb, 0.82) * 0.93 + 0.03;
  // sRGB is near a power law: the product of the encoded is the encoded product.
  tone = mix(calm, HIGHLIGHT, 0.7 * texel(3).y) * sqrt(light);
  ${isCut ? "place = view; isInside = isBack && texel(3).z > 0.5 ? 1.0 : 0.0;" : ""}
  gl_Position = clip(view);
}`;
}

/**
 * The inside of a solid is seen where it is cut open: it is painted flat and hatched, as if it were the face
 * of the cut.
 */
export const CUT_PICTURE_FRAGMENT = `#version 300 es
precision highp float;
flat in vec3 tone;
out vec4 pixel;
${CUT}
void main() {
  cut();
  float hatch = mod(gl_FragCoord.x + gl_FragCoord.y, 9.0) < 1.5 ? 0.62 : 0.84;
  pixel = vec4(isInside > 0.5 ? vec3(0.95, 0.72, 0.45) * hatch : tone, 1.0);
}`;

export const PICTURE_FRAGMENT = `#version 300 es
precision mediump float;
flat in vec3 tone;
out vec4 pixel;
void main() { pixel = vec4(tone, 1.0); }`;

/** The number of the drawable or of the object at each pixel, and the bits of its distance along the view. */
export function itemVertex(
  number: DrawNumber,
  depth: Depth,
  isCut = false,
  of: "drawable" | "object" = "drawable",
): string {
  return `${head(number, depth)}
flat out highp uint item;
${isCut ? CUT_OUT : ""}
void main() {
  vec4 x = texel(0), y = texel(1), z = texel(2);
  vec4 p = vec4(local, 1.0);
  vec3 view = vec3(dot(x, p), dot(y, p), dot(z, p));
  item = floatBitsToUint(texel(3).${of === "drawable" ? "x" : "w"});
  ${isCut ? "place = view; isInside = 0.0;" : ""}
  gl_Position = clip(view);
}`;
}

export const CUT_ITEM_FRAGMENT = `#version 300 es
precision highp float;
precision highp int;
flat in highp uint item;
layout(location = 0) out highp uvec4 pixel;
${CUT}
void main() {
  cut();
  pixel = uvec4(item, floatBitsToUint(1.0 / gl_FragCoord.w), 0u, 0u);
}`;

export const ITEM_FRAGMENT = `#version 300 es
precision highp float;
precision highp int;
flat in highp uint item;
layout(location = 0) out highp uvec4 pixel;
void main() { pixel = uvec4(item, floatBitsToUint(1.0 / gl_FragCoord.w), 0u, 0u); }`;

/** A triangle over the whole picture. */
export const WHOLE_VERTEX = `#version 300 es
void main() {
  gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0);
}`;

/**
 * Lines over a picture: on the nearer side of where one object ends before another, and where a surface
 * bends. One over the distance is linear across the picture of a plane: what is left of its second difference
 * is a bend.
 */
export const STILL_FRAGMENT = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp usampler2D;
uniform sampler2D colours;
uniform usampler2D objects;
uniform float bend;
out vec4 pixel;

uvec2 object(ivec2 at) {
  return texelFetch(objects, clamp(at, ivec2(0), textureSize(objects, 0) - 1), 0).xy;
}

/** One over the distance; nothing is infinitely far away. */
float nearness(uvec2 object) {
  return object.x == 0xffffffffu ? 0.0 : 1.0 / uintBitsToFloat(object.y);
}

void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  vec3 colour = texelFetch(colours, at, 0).rgb;
  uvec2 here = object(at);
  float near = nearness(here);
  float line = 0.0;
  for (int axis = 0; axis < 2; axis += 1) {
    ivec2 by = axis == 0 ? ivec2(1, 0) : ivec2(0, 1);
    uvec2 before = object(at - by), after = object(at + by);
    float left = nearness(before), right = nearness(after);
    float off = abs(left + right - 2.0 * near);
    // Of two objects in one plane now the one shows, now the other: there is no line between them.
    bool ends = ((before.x != here.x && left < near) || (after.x != here.x && right < near)) &&
      off > 0.12 * bend * near;
    bool bends = before.x == here.x && after.x == here.x && off > bend * near;
    line = max(line, ends ? 0.55 : bends ? 0.3 : 0.0);
  }
  pixel = vec4(colour * (1.0 - line), 1.0);
}`;
