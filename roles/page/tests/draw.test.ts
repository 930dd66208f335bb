import assert from "node:assert/strict";
import { test } from "node:test";
import { Allocator, type Place } from "../src/draw/allocator.ts";
import { DrawOrder } from "../src/draw/order.ts";
import { turned, worldToCamera, writeRows } from "../src/draw/view.ts";
import type { DrawableRecord } from "../src/proto/records.ts";
import { Walker } from "../src/walk/walker.ts";
import { randomOf } from "./support.ts";

test("places never overlap, and all room comes back as one", () => {
  for (let seed = 1; seed <= 20; seed += 1) {
    const roll = randomOf(seed);
    const allocator = new Allocator();
    allocator.grow(1000);
    const held: Place[] = [];
    for (let step = 0; step < 500; step += 1) {
      if (roll(3) > 0) {
        const place = allocator.take(1 + roll(60));
        if (place === undefined) {
          allocator.grow(allocator.capacity + 100);
        } else {
          held.push(place);
        }
      } else if (held.length > 0) {
        allocator.give(held.splice(roll(held.length), 1)[0] ?? { offset: 0, length: 0 });
      }
      const sorted = [...held].sort((a, b) => a.offset - b.offset);
      for (const [at, { offset, length }] of sorted.entries()) {
        assert.ok(offset + length <= (sorted[at + 1]?.offset ?? allocator.capacity), "two places overlap");
      }
      assert.equal(
        allocator.used,
        held.reduce((sum, { length }) => sum + length, 0),
      );
    }
    for (const place of held) {
      allocator.give(place);
    }
    assert.deepEqual(allocator.take(allocator.capacity), { offset: 0, length: allocator.capacity });
  }
});

test("the smallest place that is large enough is taken", () => {
  const allocator = new Allocator();
  allocator.grow(100);
  const places = [30, 10, 20, 10, 30].map((length) => allocator.take(length));
  for (const at of [0, 2]) {
    allocator.give(places[at] ?? { offset: 0, length: 0 });
  }
  assert.deepEqual(allocator.take(15), { offset: 40, length: 15 });
  assert.equal(allocator.take(31), undefined);
});

function record(id: number, min: readonly [number, number, number]): DrawableRecord {
  const max = [min[0] + 1, min[1] + 1, min[2] + 1] as const;
  const rest = { origin: [0, 0, 0], linear: [1, 0, 0, 0, 1, 0, 0, 0, 1], node: 0, geometry: 0 } as const;
  return { ...rest, id, worldMin: min, worldMax: max, triangles: 1, sides: 0, object: 0, objects: 1 };
}

test("the nearest box comes first, and of boxes as near the lower number", () => {
  const drawables = [
    record(9, [5, 0, 0]),
    record(7, [-0.5, -0.5, -0.5]),
    record(3, [0, 0, 0]),
    record(4, [2, 0, 0]),
  ];
  const order = new DrawOrder();
  assert.deepEqual([...order.sort([0.1, 0.1, 0.1], drawables)], [2, 1, 3, 0]);
  assert.deepEqual([...order.sort([5.5, 0.5, 0.5], drawables)], [0, 3, 2, 1]);
});

test("the camera looks down its own -z, and what is far from the origin is as fine as what is near", () => {
  const walker = new Walker([0, 0, 0], [1, 0, 0], 1);
  const rows = worldToCamera(walker.orientation);
  const ahead = turned(rows, [1, 0, 0]);
  for (const [at, expected] of [0, 0, -1].entries()) {
    assert.ok(Math.abs((ahead[at] ?? 9) - expected) < 1e-12, `${ahead}`);
  }
  const linear = [1, 0, 0, 0, 1, 0, 0, 0, 1];
  const [near, far] = [new Float32Array(12), new Float32Array(12)];
  writeRows(near, 0, rows, [0, 0, 0], { origin: [3.25, 1.5, -2], linear });
  writeRows(far, 0, rows, [524_288, 0, -524_288], { origin: [524_291.25, 1.5, -524_290], linear });
  assert.deepEqual(far, near);
});

test("keys move the eye along the ground, the mouse turns it, and it never looks straight up", () => {
  const walker = new Walker([1, 2, 3], [0, 0, -1], 2);
  assert.equal(walker.step(0.1), false);
  assert.equal(walker.key("KeyW", true), true);
  assert.equal(walker.key("KeyX", true), false);
  assert.equal(walker.step(0.05), true);
  assert.deepEqual(walker.eye, [1, 2, 2.9]);
  walker.step(60);
  assert.ok(Math.abs(walker.eye[2] - 2.7) < 1e-12, "a page that slept does not jump");
  walker.release();
  assert.equal(walker.step(1), false);
  walker.look(0, -100_000);
  assert.ok(walker.pitch < Math.PI / 2 && walker.forward[1] > 0.99);
  const length = Math.hypot(...walker.orientation);
  assert.ok(Math.abs(length - 1) < 1e-12);
});
