import assert from "node:assert/strict";
import { test } from "node:test";
import { Projection } from "../src/draw/projection.ts";
import type { Section } from "../src/proto/viewState.ts";
import { handlesOf, metresOf } from "../src/tools/handles.ts";

/** Looks along -z from z = 10, over 200 x 200 pixels: at z = 0 a pixel is 0.1 m. */
const PROJECTION = new Projection(
  { eye: [0, 0, 10], orientation: [0, 0, 0, 1], tanHalfFov: 1, near: 0.1 },
  200,
  200,
);

test("a handle of a box follows the pointer along its axis, and the other sides stay", () => {
  const box: Section = { kind: "box", lower: [-1, -2, 0], upper: [3, 2, 0.5] };
  const handles = handlesOf(box);
  assert.deepEqual(
    handles.map(({ name, point }) => [name, ...point]),
    [
      ["lower x", -1, 0, 0.25],
      ["upper x", 3, 0, 0.25],
      ["lower y", 1, -2, 0.25],
      ["upper y", 1, 2, 0.25],
      ["lower z", 1, 0, 0],
      ["upper z", 1, 0, 0.5],
    ],
  );
  const handle = handles[1];
  assert.ok(handle);
  // 9.75 m away a pixel is 0.0975 m. Motion across the axis is ignored.
  const metres = metresOf(handle, PROJECTION, 20, 7);
  assert.ok(Math.abs(metres - 1.95) < 1e-9, `${metres}`);
  assert.deepEqual(handle.drag(2), { ...box, upper: [5, 2, 0.5] });
  assert.deepEqual(handle.drag(-9), box, "it does not turn inside out");
});

test("a plane that is seen from its end goes away from the eye where the hand goes up", () => {
  const plane: Section = { kind: "plane", point: [0, 0, 0], direction: [0, 0, 2] };
  const [handle] = handlesOf(plane);
  assert.ok(handle);
  assert.deepEqual(handle.axis, [0, 0, 1]);
  const metres = metresOf(handle, PROJECTION, 50, -30);
  assert.ok(Math.abs(metres + 3) < 1e-9, `${metres}`);
  assert.deepEqual(handle.drag(metres), { ...plane, point: [0, 0, -3] });
});

test("a handle behind the eye is not dragged", () => {
  const [handle] = handlesOf({ kind: "plane", point: [0, 0, 20], direction: [1, 0, 0] });
  assert.ok(handle);
  assert.equal(metresOf(handle, PROJECTION, 10, 10), 0);
});
