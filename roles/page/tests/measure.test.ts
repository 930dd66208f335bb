import assert from "node:assert/strict";
import { test } from "node:test";
import type { Camera } from "../src/draw/model.ts";
import { Projection } from "../src/draw/projection.ts";
import { Gaze } from "../src/navigate/gaze.ts";
import { distance, type Point } from "../src/space/point.ts";
import { snap } from "../src/tools/snap.ts";
import { drawableAt } from "./drawScene.ts";

const CAMERA: Camera = {
  eye: [1e6, 5, -3],
  orientation: new Gaze([0.5, -0.2, -0.8]).orientation,
  tanHalfFov: 0.6,
  near: 0.1,
};
const PROJECTION = new Projection(CAMERA, 800, 600);

function isNear(a: Point, b: Point, within: number): void {
  assert.ok(distance(a, b) <= within, `${a} is not ${b}`);
}

test("a point shows where the ray through that place goes", () => {
  for (const [x, y, depth] of [
    [400, 300, 1],
    [0, 0, 30],
    [799, 12, 0.2],
    [123, 590, 4000],
  ] as const) {
    const point = PROJECTION.point({ x, y, depth });
    const place = PROJECTION.place(point);
    assert.ok(place);
    assert.ok(Math.hypot(place.x - x, place.y - y) < 1e-5, `${place.x} ${place.y}`);
    assert.ok(Math.abs(place.depth - depth) < 1e-8);
  }
  const [ahead, centre] = [
    new Gaze([0.5, -0.2, -0.8]).forward,
    PROJECTION.point({ x: 400, y: 300, depth: 2 }),
  ];
  isNear(centre, [1e6 + 2 * ahead[0], 5 + 2 * ahead[1], -3 + 2 * ahead[2]], 1e-9);
  assert.equal(PROJECTION.place(PROJECTION.point({ x: 1, y: 1, depth: 0.05 })), undefined);
  assert.ok(Math.abs(PROJECTION.metresEach(10) - 0.02) < 1e-12);
});

test("a line ends at the near plane, and one before it does not show", () => {
  const at = (depth: number) => PROJECTION.point({ x: 500, y: 200, depth });
  const behind: Point = [2e6 - at(5)[0], 10 - at(5)[1], -6 - at(5)[2]];
  const line = PROJECTION.line(behind, at(5));
  assert.ok(line);
  assert.ok(Math.abs(line[0].depth - 0.1001) < 1e-9 && Math.abs(line[1].depth - 5) < 1e-9);
  assert.ok(Math.abs(line[1].x - 500) < 1e-6);
  assert.equal(PROJECTION.line(behind, behind), undefined);
});

test("a vertex goes before an edge, an edge before a face, and what is hidden behind does not count", () => {
  // A square of 2 m that faces the eye at 10 m, and the same 4 m behind it.
  const camera: Camera = { eye: [0, 0, 0], orientation: [0, 0, 0, 1], tanHalfFov: 0.5, near: 0.1 };
  const projection = new Projection(camera, 1000, 1000);
  const square = (z: number, half: number) =>
    [-1, 1, 1, -1].flatMap((x, corner) => [half * x, corner < 2 ? -half : half, z]);
  const triangles = {
    positions: Float32Array.from([...square(-10, 1), ...square(-14, 1.35)]),
    indices: Uint32Array.from([0, 1, 2, 0, 2, 3, 4, 5, 6, 4, 6, 7]),
  };
  const one = drawableAt(0, [0, 0, 0]);
  const meant = (x: number, y: number) => {
    const place = { x: 500 + 100 * x, y: 500 - 100 * y, depth: 10 };
    return snap(place, one, triangles, projection);
  };
  const corner = meant(0.95, 0.96);
  assert.equal(corner.to, "vertex");
  isNear(corner.point, [1, 1, -10], 1e-6);
  const edge = meant(0.95, 0.3);
  assert.equal(edge.to, "edge");
  isNear(edge.point, [1, 0.3, -10], 1e-6);
  const face = meant(0.6, 0.2);
  assert.equal(face.to, "face");
  isNear(face.point, [0.6, 0.2, -10], 1e-9);
  // The square behind shows its corner at 0.964 of these, and is not met.
  assert.notDeepEqual(meant(0.96, 0.96).point[2], -14);
});
