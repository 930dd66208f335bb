/** The shaders. Positions are relative to the eye, in camera space, before they reach the device. */

import { MOST_PLANES } from "./cut.ts";
import type { Depth, DrawNumber } from "./features.ts";
import { COLOUR, NORMAL, POSITION, SOFT } from "./page.ts";

/** Texels per drawable: three matrix rows, and one with number, colour, solid flag and object. */
export const TEXELS = 4;
/** Drawables per row of their texture. */
export const PER_ROW = 256;

/**
 * The cosine of the smallest angle of a crease, 35 degrees. Pipes of twelve sides are round, and chamfers of
 * 45 degrees stay sharp. A line is drawn along every crease, and along nothing that is round.
 */
export const BEND = 0.82;

/** Shared by all vertex shaders, so that a triangle covers the same samples at the same depth in each. */
function head(number: DrawNumber, depth: Depth): string {
  const extension = number === "multi-draw" ? "#extension GL_ANGLE_multi_draw : require" : "";
  const draw = number === "multi-draw" ? "(first + gl_DrawID)" : "first";
  // Depth is this divided by the distance.
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
// The shift of the picture.
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
 * Vertex outputs for sections: the position in camera space, and whether the inside of a solid is visible.
 */
const CUT_OUT = `
out vec3 place;
flat out float isInside;`;

/** Discards fragments that a section cuts away: see `cut.ts`. */
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

/** Decodes an octahedral normal, whose absolute coordinates add up to 1, from two of them. */
export const UNFOLDED = `
vec3 unfolded(vec2 f) {
  float z = 1.0 - abs(f.x) - abs(f.y);
  float under = max(-z, 0.0);
  return vec3(f.x + (f.x >= 0.0 ? -under : under), f.y + (f.y >= 0.0 ? -under : under), z);
}`;

/** A folded normal in camera space, a unit vector, by the rows of a matrix. */
const NORMAL_OF = `
${UNFOLDED}

vec3 normalOf(vec2 code, vec3 x, vec3 y, vec3 z) {
  vec3 n = unfolded(code);
  // Cofactors keep a normal perpendicular to its plane under any scale.
  vec3 normal = vec3(dot(cross(y, z), n), dot(cross(z, x), n), dot(cross(x, y), n));
  return normal * inversesqrt(max(dot(normal, normal), 1e-36));
}`;

/**
 * Light from a sky, which is brighter than the ground, and from over the viewer's shoulder: the factor of a
 * colour, by the normal of the surface.
 */
const LIT = `
uniform vec3 up;
const vec3 KEY = vec3(0.36, 0.48, 0.80);
float lit(vec3 normal) {
  float light = 0.17 + 0.27 * (0.5 + 0.5 * dot(normal, up)) + 0.56 * max(dot(normal, KEY), 0.0);
  // sRGB is near a power law, so the product of encoded values is the encoded product.
  return sqrt(light);
}`;

/**
 * Shades each triangle by its one normal. The lights are directional, so flat surfaces look flat, however
 * they were triangulated.
 *
 * If it is soft, round surfaces have their vertices' normals, and fragments compute the light.
 */
export function pictureVertex(number: DrawNumber, depth: Depth, isCut = false, isSoft = false): string {
  return `${head(number, depth)}
flat out vec3 tone;
${isSoft ? SOFT_OUT : LIT}
${isCut ? CUT_OUT : ""}
const vec3 HIGHLIGHT = vec3(1.0, 0.55, 0.10);
${NORMAL_OF}

void main() {
  vec4 x = texel(0), y = texel(1), z = texel(2);
  vec4 p = vec4(local, 1.0);
  vec3 view = vec3(dot(x, p), dot(y, p), dot(z, p));
  vec3 normal = normalOf(folded, x.xyz, y.xyz, z.xyz);
  bool isBack = dot(normal, view) * dot(cross(x.xyz, y.xyz), z.xyz) > 0.0;
  // Both sides of a triangle are lit alike, for any winding and even in a mirror.
  normal = dot(normal, view) > 0.0 ? -normal : normal;
  // Plants come in pure red and green: a little grey makes them less garish.
  float grey = dot(colour.rgb, vec3(0.299, 0.587, 0.114));
  vec3 calm = mix(vec3(grey), colour.rgb, 0.82) * 0.93 + 0.03;
  // See the batch: bits of a colour, whether it is one, and whether the drawable is highlighted.
  uint bits = floatBitsToUint(texel(3).y);
  vec3 paint = vec3((uvec3(bits) >> uvec3(16u, 8u, 0u)) & 255u) / 255.0;
  calm = (bits & 0x1000000u) != 0u ? paint : calm;
  float highlight = (bits & 0x2000000u) != 0u ? 0.7 : 0.0;
  tone = mix(calm, HIGHLIGHT, highlight);
  ${isSoft ? SOFTEN : "tone *= lit(normal);"}
  ${isCut ? "place = view; isInside = isBack && texel(3).z > 0.5 ? 1.0 : 0.0;" : ""}
  gl_Position = clip(view);
}`;
}

/** Vertex outputs of soft pictures: the triangle's normal, and the vertex's, which counts if `isRound`. */
const SOFT_OUT = `
layout(location = ${SOFT}) in uint soft;
flat out vec3 facing;
flat out float isRound;
centroid out vec3 bent;`;

const SOFTEN = `facing = normal;
  isRound = float(soft & 1u);
  bent = normalOf(unpackSnorm2x16(soft), x.xyz, y.xyz, z.xyz);`;

/** The colour of a fragment, in soft pictures by its own normal. */
const SOFT_SHADE = `
flat in vec3 facing;
flat in float isRound;
centroid in vec3 bent;
${LIT}
vec3 shade() {
  vec3 normal = bent * inversesqrt(max(dot(bent, bent), 1e-36));
  // On the side of its triangle that is seen.
  normal = dot(normal, facing) < 0.0 ? -normal : normal;
  return tone * lit(isRound > 0.5 ? normal : facing);
}`;

/**
 * The inside of a solid is visible where it is cut open: it is painted flat and hatched, like the face of the
 * cut.
 */
export function pictureFragment(isCut: boolean, isSoft: boolean): string {
  return `#version 300 es
precision ${isCut || isSoft ? "highp" : "mediump"} float;
flat in vec3 tone;
out vec4 pixel;
${isSoft ? SOFT_SHADE : "vec3 shade() { return tone; }"}
${isCut ? `${CUT}${HATCHED}` : "void main() { pixel = vec4(shade(), 1.0); }"}`;
}

const HATCHED = `
void main() {
  cut();
  float hatch = mod(gl_FragCoord.x + gl_FragCoord.y, 9.0) < 1.5 ? 0.62 : 0.84;
  pixel = vec4(isInside > 0.5 ? vec3(0.95, 0.72, 0.45) * hatch : shade(), 1.0);
}`;

/**
 * The number of the drawable at each pixel, and the bits of its distance along the view; or the number of the
 * object, its distance, and its normal in camera space.
 */
export function itemVertex(
  number: DrawNumber,
  depth: Depth,
  isCut = false,
  of: "drawable" | "object" = "drawable",
): string {
  const isObject = of === "object";
  return `${head(number, depth)}
flat out highp uint item;
flat out highp vec3 normal;
${isCut ? CUT_OUT : ""}
${isObject ? NORMAL_OF : ""}
void main() {
  vec4 x = texel(0), y = texel(1), z = texel(2);
  vec4 p = vec4(local, 1.0);
  vec3 view = vec3(dot(x, p), dot(y, p), dot(z, p));
  item = floatBitsToUint(texel(3).${isObject ? "w" : "x"});
  normal = ${isObject ? "normalOf(folded, x.xyz, y.xyz, z.xyz)" : "vec3(0.0)"};
  ${isCut ? "place = view; isInside = 0.0;" : ""}
  gl_Position = clip(view);
}`;
}

export function itemFragment(isCut: boolean): string {
  return `#version 300 es
precision highp float;
precision highp int;
flat in highp uint item;
flat in highp vec3 normal;
layout(location = 0) out highp uvec4 pixel;
${isCut ? CUT : "void cut() {}"}
void main() {
  cut();
  uint depth = floatBitsToUint(1.0 / gl_FragCoord.w);
  pixel = uvec4(item, depth, packSnorm2x16(normal.xy), packSnorm2x16(vec2(normal.z, 0.0)));
}`;
}

/** How far ambient occlusion looks, in heights of the picture. */
export const OCCLUSION_REACH = 0.08;

/** A triangle over the whole picture. */
export const WHOLE_VERTEX = `#version 300 es
void main() {
  gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0);
}`;

/**
 * Lines over a picture: on the nearer side of a depth step, and on both sides of a crease between two
 * surfaces. And ambient occlusion, after Alchemy (McGuire et al. 2011).
 *
 * Each pixel's surface is compared as a plane. So a plane has no lines at any viewing angle. Neither have
 * several objects in one plane, nor stand-ins with a little error.
 */
export const STILL_FRAGMENT = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp usampler2D;
uniform sampler2D colours;
// The opaque objects, and all of them: for each pixel the object, its distance and its normal.
uniform usampler2D objects;
uniform usampler2D allObjects;
uniform bool hasSeeThrough;
// Tangents of a pixel's width and height, and the shift of the picture in pixels.
uniform vec2 each;
uniform vec2 offset;
// How strong lines are.
uniform float strength;
// The lower left corner in the whole picture, and the height of that, pixels.
uniform ivec2 corner;
uniform float wholeHeight;
// Turns the places around a pixel that ambient occlusion looks at, from 0 to 1.
uniform float turn;
out vec4 pixel;

const uint NONE = 0xffffffffu;
// The cosine of the smallest angle of a crease. The sides of stand-ins for round objects stay below it.
const float BEND = ${BEND};
// The lowest depth step that counts, in widths of a pixel.
const float STEP = 1.0;
// Limits the slope of surfaces at grazing angles, by the change of distance from pixel to pixel.
const float FLATTEST = 64.0;

struct Surface {
  uint object;
  // One over the distance along the view: linear across the picture of a plane.
  float near;
  vec3 normal;
  vec3 ray;
};

Surface surface(usampler2D of, ivec2 at) {
  ivec2 size = textureSize(of, 0);
  uvec4 texel = texelFetch(of, clamp(at, ivec2(0), size - 1), 0);
  vec2 middle = vec2(at) + 0.5 - 0.5 * vec2(size) - offset;
  float near = texel.x == NONE ? 0.0 : 1.0 / uintBitsToFloat(texel.y);
  vec3 normal = vec3(unpackSnorm2x16(texel.z), unpackSnorm2x16(texel.w).x);
  return Surface(texel.x, near, normal, vec3(middle * each, -1.0));
}

// One over the distance at which another ray meets the plane of a surface.
float extended(Surface of, vec3 ray) {
  float here = dot(of.normal, of.ray);
  float most = FLATTEST * each.y;
  float change = abs(here) < 1e-4 ? most : dot(of.normal, ray) / here - 1.0;
  return of.near * (1.0 + clamp(change, -most, most));
}

// How far a surface is before the plane of another one, in widths of a pixel: below 0 it is behind. Excludes
// the effect of position errors on the slope.
float before(Surface one, Surface plane) {
  float there = extended(plane, one.ray);
  float off = one.near - there;
  float more = max(abs(off) - 0.5 * abs(there - plane.near), 0.0);
  return sign(off) * more / (each.y * plane.near);
}

// Whether two pixels may be of one surface: coplanar objects count as one.
bool isOne(Surface one, Surface other) {
  bool isFlat = abs(before(one, other)) < 2.0 * STEP && abs(dot(one.normal, other.normal)) > BEND;
  return one.object == NONE || other.object == NONE ? one.object == other.object : isFlat;
}

float line(usampler2D of, ivec2 at) {
  Surface here = surface(of, at);
  float found = 0.0;
  // A pixel that shows something else than all around it is a crack between two triangles.
  int holes = 0;
  for (int axis = 0; axis < 2 && here.object != NONE; axis += 1) {
    ivec2 by = axis == 0 ? ivec2(1, 0) : ivec2(0, 1);
    Surface sides[2] = Surface[2](surface(of, at - by), surface(of, at + by));
    holes += isOne(sides[0], sides[1]) && !isOne(here, sides[0]) ? 1 : 0;
    for (int side = 0; side < 2; side += 1) {
      Surface there = sides[side];
      if (isOne(here, surface(of, at + (4 * side - 2) * by))) {
        continue;
      }
      bool isSame = there.object == here.object;
      bool isNothing = there.object == NONE;
      float down = isNothing ? -2.0 * STEP : before(there, here);
      float up = isNothing ? 2.0 * STEP : before(here, there);
      if (down < -STEP && up > STEP) {
        found = max(found, isSame ? 0.4 : 0.55);
      } else if (!(down > STEP && up < -STEP) && abs(dot(here.normal, there.normal)) < BEND) {
        found = max(found, isSame ? 0.3 : 0.45);
      }
    }
  }
  return holes == 2 ? 0.0 : found;
}

// The places that each picture looks at for ambient occlusion.
const int TAPS = 6;
// How far from the pixel they are, in heights of the picture.
const float REACH = ${OCCLUSION_REACH};
// Below this sine over a surface nothing counts: a round wall made of flat sides is not dark.
const float LOWEST = 0.12;

// How much of the sky over a surface is hidden by what is near it, from 0 to 1.
float occlusion(ivec2 at) {
  Surface here = surface(objects, at);
  if (here.object == NONE) {
    return 0.0;
  }
  vec3 place = here.ray / here.near;
  vec3 normal = dot(here.normal, here.ray) > 0.0 ? -here.normal : here.normal;
  float most = REACH * wholeHeight;
  // Surfaces this near to the pixel count.
  float radius = 1.6 * most * each.y / here.near;
  // Interleaved gradient noise (Jimenez 2014).
  float noise = fract(52.9829189 * fract(dot(vec2(at + corner), vec2(0.06711056, 0.00583715))));
  float sum = 0.0;
  for (int tap = 0; tap < TAPS; tap += 1) {
    float away = most * (float(tap) + fract(noise + turn)) / float(TAPS);
    float angle = 6.2831853 * (noise + turn) + 2.3999632 * float(tap);
    Surface there = surface(objects, at + ivec2(round(away * vec2(cos(angle), sin(angle)))));
    if (there.object != NONE) {
      vec3 to = there.ray / there.near - place;
      float range = length(to);
      float height = max(dot(to, normal) / max(range, 1e-20) - LOWEST, 0.0);
      sum += height * max(1.0 - range * range / (radius * radius), 0.0);
    }
  }
  return min(2.0 * sum / float(TAPS), 1.0);
}

void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  float found = line(objects, at);
  if (hasSeeThrough) {
    found = max(found, 0.7 * line(allObjects, at));
  }
  float light = (1.0 - min(strength * found, 1.0)) * (1.0 - 0.7 * occlusion(at));
  pixel = vec4(texelFetch(colours, at, 0).rgb * light, 1.0);
}`;
