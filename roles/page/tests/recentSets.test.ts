import assert from "node:assert/strict";
import { test } from "node:test";
import { RecentSets } from "../src/display/recentSets.ts";
import type { DrawableRecord } from "../src/proto/records.ts";

/** A drawable of a node, of a level by itself unless given. Its other fields do not matter. */
function drawable(id: number, node: number, level = id): DrawableRecord {
  return { id, node, level } as DrawableRecord;
}

function ids(sets: RecentSets): number[] {
  return sets.union().map(({ id }) => id);
}

test("what a node shows is what the newest set has of it", () => {
  const sets = new RecentSets();
  sets.add({ posed: 0, drawables: [drawable(1, 10), drawable(2, 20)] });
  sets.add({ posed: 50, drawables: [drawable(3, 20), drawable(4, 30), drawable(5, 30)] });
  assert.deepEqual(ids(sets), [3, 4, 5, 1]);
});

test("older sets add pieces of the level that a newer one shows", () => {
  const sets = new RecentSets();
  sets.add({ posed: 0, drawables: [drawable(1, 10, 1), drawable(2, 10, 1), drawable(9, 20, 9)] });
  sets.add({ posed: 50, drawables: [drawable(2, 10, 1), drawable(3, 10, 1), drawable(8, 20, 7)] });
  assert.deepEqual(ids(sets), [2, 3, 8, 1]);
});

test("a set is replaced by one of its pose, and forgotten when it is old", () => {
  const sets = new RecentSets();
  sets.add({ posed: 0, drawables: [drawable(1, 10)] });
  sets.add({ posed: 60, drawables: [drawable(2, 20)] });
  sets.add({ posed: 60, drawables: [drawable(3, 30)] });
  assert.deepEqual(ids(sets), [3, 1]);
  sets.add({ posed: 150, drawables: [] });
  assert.deepEqual(ids(sets), [3]);
});
