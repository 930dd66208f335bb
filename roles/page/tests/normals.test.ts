/** Normals of round surfaces: which corners have them, and where triangles stay flat. */

import assert from "node:assert/strict";
import { test } from "node:test";

import type { Mesh } from "../src/draw/model.ts";
import { type Soft, soften } from "../src/draw/normals.ts";
import type { Flat } from "../src/draw/surface.ts";
import type { Point } from "../src/space/point.ts";
import { box, MeshMaker, pipe, turned } from "./drawScene.ts";

const GREY = [200, 200, 200] as const;

function flatOf({ vertices, indices }: Mesh): Flat {
  return { words: new Float32Array(vertices.buffer), indices };
}

/** One corner of a triangle: its place, its own normal, and the one that light sees. */
interface Corner {
  readonly place: Point;
  readonly flat: Point;
  readonly seen: Point;
  readonly isRound: boolean;
}

/** All corners as a fragment shader has them. */
function cornersOf({ words }: Flat, soft: Soft, carrier = 0): Corner[] {
  const count = words.length / 5;
  const original = (at: number) => (at < count ? at : (soft.copies[at - count] ?? 0));
  const place = (at: number): Point => {
    const start = 5 * original(at);
    return [words[start] ?? 0, words[start + 1] ?? 0, words[start + 2] ?? 0];
  };
  const found: Corner[] = [];
  for (let first = 0; first < soft.indices.length; first += 3) {
    const own = [0, 1, 2].map((at) => soft.indices[first + at] ?? 0);
    const [a, b, c] = own.map(place) as [Point, Point, Point];
    const flat = unit(cross(minus(b, a), minus(c, a)));
    const isRound = ((soft.codes[own[carrier] ?? 0] ?? 0) & 1) === 1;
    for (const at of own) {
      found.push({ place: place(at), flat, seen: isRound ? unfolded(soft.codes[at] ?? 0) : flat, isRound });
    }
  }
  return found;
}

function unfolded(code: number): Point {
  const [x, y] = [((code << 16) >> 16) / 32767, (code >> 16) / 32767];
  const z = 1 - Math.abs(x) - Math.abs(y);
  const under = Math.max(-z, 0);
  return unit([x + (x >= 0 ? -under : under), y + (y >= 0 ? -under : under), z]);
}

const minus = (a: Point, b: Point): Point => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const dot = (a: Point, b: Point) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a: Point, b: Point): Point => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];
function unit(a: Point): Point {
  const length = Math.hypot(...a) || 1;
  return [a[0] / length, a[1] / length, a[2] / length];
}

function degrees(one: Point, other: Point): number {
  return (180 / Math.PI) * Math.acos(Math.min(1, dot(one, other)));
}

function softened(mesh: Mesh): { readonly soft: Soft; readonly corners: Corner[] } {
  const flat = flatOf(mesh);
  const [soft] = soften([flat], 0);
  assert.ok(soft !== undefined);
  return { soft, corners: cornersOf(flat, soft) };
}

test("the sides of a pipe of twelve sides have radial normals, and its ends stay flat", () => {
  const { soft, corners } = softened(pipe(0.2, 3, 12, 2, GREY));
  assert.equal(soft.copies.length, 0, "an end takes no copies");
  assert.equal(corners.filter(({ isRound }) => isRound).length, 3 * 48);
  for (const { place, flat, seen, isRound } of corners) {
    const isSide = Math.abs(flat[1]) < 0.5;
    assert.equal(isRound, isSide);
    const expected = isSide ? unit([place[0], 0, place[2]]) : flat;
    assert.ok(degrees(seen, expected) < 0.02, `${seen} at ${place}`);
  }
});

test("a box and a pipe of eight sides stay flat", () => {
  for (const mesh of [box([1, 2, 3]), pipe(0.2, 3, 8, 2, GREY)]) {
    const { soft, corners } = softened(mesh);
    assert.ok(corners.every(({ isRound }) => !isRound));
    assert.ok(soft.codes.every((code) => code === 0));
    assert.deepEqual([...soft.indices], [...mesh.indices]);
  }
});

test("both sides of a sharp rim are round: its vertices are copied once", () => {
  // A tank: a wall, and a roof that rises by 15 degrees. The rim is a crease of 75 degrees.
  const { soft, corners } = softened(
    turned(24, [
      [5, 0],
      [5, 4],
      [0, 4 + 5 * Math.tan(Math.PI / 12)],
    ]),
  );
  assert.equal(soft.copies.length, 24);
  assert.ok(corners.every(({ isRound }) => isRound));
  for (const { place, flat, seen } of corners) {
    const outward = unit([place[0], 0, place[2]]);
    const [along, up] = [Math.sin(Math.PI / 12), Math.cos(Math.PI / 12)];
    const isTip = Math.hypot(place[0], place[2]) < 1e-6;
    const roof = isTip ? [0, 1, 0] : [along * outward[0], up, along * outward[2]];
    const expected = Math.abs(flat[1]) < 0.1 ? outward : unit([roof[0] ?? 0, roof[1] ?? 0, roof[2] ?? 0]);
    assert.ok(degrees(seen, expected) < 0.2, `${seen}, not ${expected}, at ${place}`);
  }
});

test("at the tip of a steep cone each facet keeps to its own side", () => {
  const { soft, corners } = softened(
    turned(12, [
      [1, 0],
      [0, 4],
    ]),
  );
  assert.equal(soft.copies.length, 11, "one vertex at the tip for each facet");
  for (const { flat, seen, isRound } of corners) {
    assert.ok(isRound && degrees(seen, flat) < 16, `${seen} is far from ${flat}`);
  }
});

/** A sheet that bends: faces along z that rise by these angles. Each is 1 wide, the outer ones 20. */
function bent(angles: readonly number[]): Mesh {
  const maker = new MeshMaker();
  const facet = [GREY, [0, 1, 0]] as const;
  let [x, y] = [0, 0];
  for (const [at, angle] of angles.entries()) {
    const [width, turn] = [at % (angles.length - 1) === 0 ? 20 : 1, (Math.PI * angle) / 180];
    const next = [x + width * Math.cos(turn), y + width * Math.sin(turn)] as const;
    const places: Point[] = [
      [x, y, 0],
      [x, y, 9],
      [...next, 9],
      [...next, 0],
    ];
    maker.face(...places.map((place) => maker.vertex(place, facet)));
    [x, y] = next;
  }
  return maker.mesh();
}

test("a chamfer of 45 degrees stays sharp, and a fillet bends while the faces beside it stay flat", () => {
  assert.ok(softened(bent([0, 45, 90])).corners.every(({ isRound }) => !isRound));
  const fillet = softened(bent([0, 22.5, 45, 67.5, 90])).corners;
  assert.ok(fillet.every(({ isRound }) => isRound));
  const [wide, narrow] = [fillet.slice(0, 6), fillet.slice(6, 12)];
  assert.ok(wide.every(({ flat, seen }) => degrees(flat, seen) < 1.5));
  assert.ok(narrow.some(({ flat, seen }) => degrees(flat, seen) > 20));
});

test("surfaces run through pieces, colours and doubled vertices", () => {
  const whole = pipe(0.2, 3, 24, 2, GREY);
  const half = whole.indices.length / 6;
  const parts = [whole.indices.slice(0, 3 * half), whole.indices.slice(3 * half)].map((indices) => {
    // Each corner a vertex of its own.
    const vertices = new Uint8Array(20 * indices.length);
    for (const [at, index] of indices.entries()) {
      vertices.set(whole.vertices.subarray(20 * index, 20 * index + 20), 20 * at);
    }
    return flatOf({ vertices, indices: indices.map((_, at) => at) });
  });
  const softs = soften(parts, 0);
  const corners = parts.flatMap((part, at) => cornersOf(part, softs[at] as Soft));
  assert.deepEqual(
    softs.map(({ copies }) => copies.length),
    [0, 0],
  );
  for (const { place, flat, seen } of corners) {
    const expected = Math.abs(flat[1]) < 0.5 ? unit([place[0], 0, place[2]]) : flat;
    assert.ok(degrees(seen, expected) < 0.02, `${seen} at ${place}`);
  }
});

test("the carrier may be the last corner, and positions and order stay", () => {
  const mesh = turned(16, [
    [1, 0],
    [1, 2],
    [0, 2.3],
  ]);
  const indices = mesh.indices.map((_, at, all) => all[at - (at % 3) + ((at + 1) % 3)] ?? 0);
  const flat = { ...flatOf(mesh), indices };
  const [soft] = soften([flat], 2);
  assert.ok(soft !== undefined && soft.copies.length === 16);
  const count = flat.words.length / 5;
  const back = soft.indices.map((at) => (at < count ? at : (soft.copies[at - count] ?? 0)));
  assert.deepEqual([...back], [...indices]);
  assert.ok(cornersOf(flat, soft, 2).every(({ isRound, flat, seen }) => isRound && dot(flat, seen) > 0.9));
});

test("triangles without area change nothing, and have no normals that are none", () => {
  const mesh = pipe(0.2, 3, 12, 1, GREY);
  const [a = 0, b = 0] = mesh.indices;
  const thin = Uint32Array.of(...mesh.indices, a, a, b, b, b, b);
  const { soft, corners } = softened({ ...mesh, indices: thin });
  assert.equal(soft.copies.length, 0);
  assert.equal(corners.filter(({ isRound }) => isRound).length, 3 * (24 + 2));
  assert.ok(corners.every(({ seen }) => seen.every(Number.isFinite)));
  const none = softened({ vertices: new Uint8Array(60), indices: Uint32Array.of(0, 1, 2) });
  assert.deepEqual([...none.soft.codes], [0, 0, 0]);
  const empty = softened({ vertices: new Uint8Array(0), indices: new Uint32Array(0) });
  assert.equal(empty.soft.codes.length, 0);
});
