/** The measures of polygons. */

import assert from "node:assert/strict";
import { test } from "node:test";
import type { Snapped } from "../src/service/service.ts";
import type { Point } from "../src/space/point.ts";
import { areaText, polygonOf, polygonTexts } from "../src/tools/polygons.ts";

/** A polygon on the floor, by its x and z. */
const onFloor = (...corners: readonly (readonly [number, number])[]): readonly Point[] =>
  corners.map(([x, z]) => [x, 0, z]);

function isNear(points: readonly Point[], area: number, perimeter: number, off = 0): void {
  const polygon = polygonOf(points);
  const pairs = [
    [polygon?.area, area],
    [polygon?.perimeter, perimeter],
    [polygon?.off, off],
  ] as const;
  for (const [is, expected] of pairs) {
    assert.ok(is !== undefined && Math.abs(is - expected) < 1e-8, `${is} is not ${expected}`);
  }
}

const picked = (points: readonly Point[], error: number | undefined = 0): readonly Snapped[] =>
  points.map((point) => ({ point, error, to: "vertex" }));

const SQUARE = onFloor([0, 0], [2, 0], [2, 2], [0, 2]);
const EL = onFloor([0, 0], [4, 0], [4, 1], [1, 1], [1, 3], [0, 3]);

test("a polygon has its area and its perimeter, whatever its shape and its place", () => {
  isNear(SQUARE, 4, 8);
  isNear([...SQUARE].reverse(), 4, 8);
  isNear(EL, 6, 14);
  isNear([...EL.slice(2), ...EL.slice(0, 2)], 6, 14);
  // Tilted by 45 degrees about x, in a plant far from the origin.
  const half = Math.SQRT1_2;
  const tilted = EL.map(([x, , z]): Point => [x + 432_100, half * z + 7, half * z - 6_789_012]);
  const polygon = polygonOf(tilted);
  assert.ok(Math.abs((polygon?.area ?? 0) - 6) < 1e-7, `${polygon?.area}`);
  isNear(onFloor([0, 0], [3, 0], [0, 4]), 6, 12);
  // A corner in the middle of an edge, and one that is picked twice.
  isNear(onFloor([0, 0], [1, 0], [2, 0], [2, 2], [2, 2], [0, 2]), 4, 8);
});

test("a polygon that is not flat is projected on its plane", () => {
  const bent = SQUARE.map(([x, , z], at): Point => [x, at % 2 === 0 ? 0.1 : -0.1, z]);
  isNear(bent, 4, 4 * Math.hypot(2, 0.2), 0.1);
  assert.deepEqual(polygonTexts(picked(bent), "m"), [
    "4.0000 m² projected on a plane",
    "perimeter 8.040 m",
    "corners up to 0.100 m off that plane",
  ]);
});

test("edges that cross make no area, and edges that touch do", () => {
  // An eight, whose parts cancel out, one with unequal parts, and a star.
  const star = onFloor([0, 3], [2, -3], [-3, 1], [3, 1], [-2, -3]);
  for (const crossing of [
    onFloor([0, 0], [2, 2], [2, 0], [0, 2]),
    onFloor([0, 0], [3, 3], [3, 0], [0, 1]),
    star,
  ]) {
    const polygon = polygonOf(crossing);
    assert.ok(polygon !== undefined && polygon.area === undefined && polygon.off < 1e-12);
  }
  const eight = onFloor([0, 0], [3, 4], [3, 0], [0, 4]);
  assert.deepEqual(polygonTexts(picked(eight), "m"), ["no area: the edges cross", "perimeter 18.000 m"]);
  // A corner lies on another edge.
  isNear(onFloor([0, 0], [4, 0], [4, 2], [2, 0], [0, 2]), 4, 8 + 2 * Math.SQRT2 * 2);
});

test("there is no polygon of fewer than three corners, or of corners on one line", () => {
  for (const points of [
    [],
    onFloor([1, 1]),
    onFloor([1, 1], [2, 5]),
    onFloor([1, 1], [2, 2], [5, 5]),
    onFloor([1, 1], [1, 1], [1, 1]),
    [[Number.NaN, 0, 0] as const, ...SQUARE],
  ]) {
    assert.equal(polygonOf(points), undefined);
    assert.deepEqual(polygonTexts(picked(points), "m"), ["no area: all corners are on one line"]);
  }
});

test("an area has its error and its unit", () => {
  assert.deepEqual(polygonTexts(picked(SQUARE), "mm"), ["4.0000 m²", "perimeter 8000 mm"]);
  // Each corner may be 1 cm off, across a diagonal of 2.83 m.
  assert.deepEqual(polygonTexts(picked(SQUARE, 0.01), "m"), [
    "4.0000 m² ± 0.0566 m²",
    "perimeter 8.000 m ± 0.080 m",
  ]);
  const about = picked(SQUARE).map((one, at) => (at === 2 ? { ...one, error: undefined } : one));
  assert.deepEqual(polygonTexts(about, "m"), ["about 4.0000 m²", "perimeter about 8.000 m"]);
  assert.equal(areaText(1, 0, "ft-in"), "10.764 ft²");
  assert.equal(areaText(1, 0.00004, "m"), "1.0000 m²");
});
