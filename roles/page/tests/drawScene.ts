/** Meshes and poses for tests of drawing. */

import type { Camera, Drawable, Mesh } from "../src/draw/model.ts";
import { VERTEX_BYTES } from "../src/proto/piece.ts";
import { BOTH_SIDES, FRONT_SIDE } from "../src/proto/sides.ts";
import { type Point, pointOf } from "../src/space/point.ts";

export type Colour = readonly [number, number, number];

/** No rotation. */
export const AHEAD = [0, 0, 0, 1] as const;
/** The linear part of a drawable without rotation or scale. */
export const UPRIGHT: readonly number[] = [1, 0, 0, 0, 1, 0, 0, 0, 1];

/** A camera at the world's origin that looks along -z. */
export function cameraAt(eye: Point, tanHalfFov = 0.5, near = 0.1): Camera {
  return { eye, orientation: AHEAD, tanHalfFov, near };
}

/** A drawable of the piece with its own number. Its node's box is a point, which only orders it. */
export function drawableAt(id: number, origin: Point, more: Partial<Drawable> = {}): Drawable {
  const box = { worldMin: origin, worldMax: origin };
  return {
    id,
    object: 1000 + id,
    objects: 1,
    geometry: id,
    origin,
    linear: UPRIGHT,
    sides: BOTH_SIDES,
    ...box,
    ...more,
  };
}

/** An encoded normal: the wire's page describes the folding. */
export function folded([x, y, z]: Point): [number, number] {
  const sum = Math.abs(x) + Math.abs(y) + Math.abs(z);
  let [u, v] = [x / sum, y / sum];
  if (z < 0) {
    [u, v] = [(1 - Math.abs(v)) * (u < 0 ? -1 : 1), (1 - Math.abs(u)) * (v < 0 ? -1 : 1)];
  }
  return [Math.round(32767 * u), Math.round(32767 * v)];
}

/** Makes a mesh vertex by vertex and triangle by triangle. */
export class MeshMaker {
  readonly #positions: Point[] = [];
  readonly #facets: (readonly [Colour, Point] | undefined)[] = [];
  readonly #indices: number[] = [];

  vertex(position: Point, facet?: readonly [Colour, Point]): number {
    this.#facets.push(facet);
    return this.#positions.push(position) - 1;
  }

  /** A convex face, counter-clockwise from its front; its first corner carries colour and normal. */
  face(...corners: readonly number[]): void {
    for (let i = 2; i < corners.length; i += 1) {
      this.#indices.push(corners[0] ?? 0, corners[i - 1] ?? 0, corners[i] ?? 0);
    }
  }

  mesh(): Mesh {
    const vertices = new Uint8Array(this.#positions.length * VERTEX_BYTES);
    const view = new DataView(vertices.buffer);
    for (const [at, position] of this.#positions.entries()) {
      const start = at * VERTEX_BYTES;
      for (const [axis, coordinate] of position.entries()) {
        view.setFloat32(start + 4 * axis, coordinate, true);
      }
      const facet = this.#facets[at];
      const [colour, normal] = facet ?? [[0, 0, 0], undefined];
      vertices.set([...colour, 255], start + 12);
      const [u, v] = normal === undefined ? [-32768, -32768] : folded(normal);
      view.setInt16(start + 16, u, true);
      view.setInt16(start + 18, v, true);
    }
    return { vertices, indices: Uint32Array.from(this.#indices) };
  }
}

/** A rectangle about the origin that faces +z. */
export function plate(width: number, height: number, colour: Colour = [200, 200, 200]): Mesh {
  const [x, y] = [width / 2, height / 2];
  const maker = new MeshMaker();
  const first = maker.vertex([-x, -y, 0], [colour, [0, 0, 1]]);
  maker.face(first, maker.vertex([x, -y, 0]), maker.vertex([x, y, 0]), maker.vertex([-x, y, 0]));
  return maker.mesh();
}

/** A box about the origin, closed. */
export function box(size: Point, colour: Colour = [200, 200, 200]): Mesh {
  const maker = new MeshMaker();
  for (const axis of [0, 1, 2]) {
    for (const side of [-1, 1]) {
      const normal = at3(axis, side, 0, 0);
      // Counter-clockwise as seen from the front.
      const corners = [0, 1, 2, 3].map((corner) => {
        const [u, v] = [corner === 1 || corner === 2 ? 1 : -1, corner > 1 ? 1 : -1];
        const [x, y, z] = at3(axis, side, u * side, v);
        const position = [(x * size[0]) / 2, (y * size[1]) / 2, (z * size[2]) / 2] as const;
        return maker.vertex(position, corner === 0 ? [colour, normal] : undefined);
      });
      maker.face(...corners);
    }
  }
  return maker.mesh();
}

/** A point with `along` on an axis, and the other two on the axes that follow. */
function at3(axis: number, along: number, next: number, last: number): Point {
  return pointOf((other) => [along, next, last][(other - axis + 3) % 3] ?? 0);
}

/** A pipe along y about the origin, closed: `sides` times `parts` rectangles and two ends. */
export function pipe(radius: number, length: number, sides: number, parts: number, colour: Colour): Mesh {
  const maker = new MeshMaker();
  const around = (side: number) => [
    Math.cos((2 * Math.PI * side) / sides),
    -Math.sin((2 * Math.PI * side) / sides),
  ];
  const rings = Array.from({ length: parts + 1 }, (_, ring) =>
    Array.from({ length: sides }, (_, side) => {
      const [x = 0, z = 0] = around(side);
      const [nx = 0, nz = 0] = around(side + 0.5);
      const y = (length * ring) / parts - length / 2;
      return maker.vertex([radius * x, y, radius * z], ring < parts ? [colour, [nx, 0, nz]] : undefined);
    }),
  );
  const at = (ring: number, side: number) => rings[ring]?.[side % sides] ?? 0;
  for (let ring = 0; ring < parts; ring += 1) {
    for (let side = 0; side < sides; side += 1) {
      maker.face(at(ring, side), at(ring, side + 1), at(ring + 1, side + 1), at(ring + 1, side));
    }
  }
  for (const [ring, y] of [
    [0, -1],
    [parts, 1],
  ] as const) {
    const centre = maker.vertex([0, (y * length) / 2, 0], [colour, [0, y, 0]]);
    for (let side = 0; side < sides; side += 1) {
      const [a, b] = [at(ring, side), at(ring, side + 1)];
      maker.face(centre, ...(y > 0 ? [a, b] : [b, a]));
    }
  }
  return maker.mesh();
}

/**
 * Rings of `sides` vertices about y, joined: each is a radius and a height. A radius of 0 is one vertex. It
 * has no normals for flat shading.
 */
export function turned(sides: number, rings: readonly (readonly [number, number])[]): Mesh {
  const maker = new MeshMaker();
  const facet = [
    [200, 200, 200],
    [0, 1, 0],
  ] as const;
  const made = rings.map(([radius, y]) =>
    Array.from({ length: radius === 0 ? 1 : sides }, (_, side) => {
      const angle = (2 * Math.PI * side) / sides;
      return maker.vertex([radius * Math.cos(angle), y, -radius * Math.sin(angle)], facet);
    }),
  );
  for (let ring = 1; ring < made.length; ring += 1) {
    const [below = [], above = []] = [made[ring - 1], made[ring]];
    const at = (of: readonly number[], side: number) => of[side % of.length] ?? 0;
    for (let side = 0; side < sides; side += 1) {
      const corners = [at(below, side), at(below, side + 1), at(above, side + 1), at(above, side)];
      maker.face(...corners.filter((corner, place) => corner !== corners[(place + 1) % 4]));
    }
  }
  return maker.mesh();
}

const PRIMES = [2, 3, 5, 7, 11, 13, 17, 19, 23];

/** A pseudo-random share from 0 to 1: the same for the same numbers. */
function share(number: number, kind: number): number {
  const product = (number + 1) * Math.sqrt(PRIMES[kind] ?? 2);
  return product - Math.floor(product);
}

/** Pipes before a camera at the origin: all in view, and many hidden. */
export function pipes(count: number, sides = 12, parts = 5): { meshes: Mesh[]; drawables: Drawable[] } {
  const ways = [UPRIGHT, [0, 1, 0, -1, 0, 0, 0, 0, 1], [1, 0, 0, 0, 0, 1, 0, -1, 0]];
  const meshes: Mesh[] = [];
  const drawables: Drawable[] = [];
  for (let id = 0; id < count; id += 1) {
    const tone = (kind: number) => Math.floor(256 * share(id, kind));
    meshes.push(
      pipe(0.05 + 0.2 * share(id, 4), 1 + 3 * share(id, 5), sides, parts, [tone(6), tone(7), tone(8)]),
    );
    const distance = 10 + 100 * share(id, 2);
    const origin = [(share(id, 0) - 0.5) * distance, (share(id, 1) - 0.5) * distance, -distance] as const;
    drawables.push(
      drawableAt(id, origin, { linear: ways[id % 3] ?? UPRIGHT, sides: id & 1 ? FRONT_SIDE : BOTH_SIDES }),
    );
  }
  return { meshes, drawables };
}
