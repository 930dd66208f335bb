/** The frame of an overview, and the pixel that a click beside an object means. */

import assert from "node:assert/strict";
import { test } from "node:test";
import { NOTHING } from "../src/draw/device.ts";
import { leastOf, metIn } from "../src/draw/met.ts";
import { ObjectSet } from "../src/proto/objectSet.ts";
import type { Box } from "../src/space/box.ts";
import { frameShown } from "../src/tools/overview.ts";
import { ViewHistory } from "../src/viewer/viewHistory.ts";

const CORE: Box = { min: [0, 0, 0], max: [9, 9, 9] };
const PART: Box = { min: [1, 1, 1], max: [2, 2, 2] };

/** A model of ten objects, and the sets whose box the service was asked for. */
function model(answer: (objects: ObjectSet) => Promise<Box>) {
  const asked: number[][] = [];
  const boxAround = (objects: ObjectSet) => {
    asked.push([...objects]);
    return answer(objects);
  };
  const view = new ViewHistory();
  return { scene: { core: CORE, objects: 10 }, service: { boxAround }, view, asked };
}

async function framed(viewer: Parameters<typeof frameShown>[0]): Promise<Box | undefined> {
  let box: Box | undefined;
  await frameShown(viewer, (found) => {
    box = found;
  });
  return box;
}

test("an overview frames what is shown, and asks only where something is not", async () => {
  const viewer = model(() => Promise.resolve(PART));
  let isFramed = false;
  void frameShown(viewer, (box) => {
    isFramed = box === CORE;
  });
  assert.ok(isFramed, "the whole model is framed at once");
  viewer.view.change({ isolated: ObjectSet.of([2, 3, 4]), hidden: ObjectSet.of([3, 7]) });
  assert.equal(await framed(viewer), PART);
  viewer.view.change({ isolated: undefined });
  assert.equal(await framed(viewer), PART);
  // Nothing is shown: the whole model is framed.
  viewer.view.change({ isolated: ObjectSet.of([3]) });
  assert.equal(await framed(viewer), CORE);
  assert.deepEqual(viewer.asked, [
    [2, 4],
    [0, 1, 2, 4, 5, 6, 8, 9],
  ]);
});

test("an overview without an answer is of the whole model, and of its shape where its box is equal", async () => {
  for (const answer of [
    () => Promise.reject(new Error("the service is away")),
    () => Promise.resolve({ min: [...CORE.min], max: [...CORE.max] } as const),
  ]) {
    const viewer = model(answer);
    viewer.view.change({ hidden: ObjectSet.of([5]) });
    assert.equal(await framed(viewer), CORE);
  }
});

test("of the pixels around a click the nearest one of an object counts", () => {
  const none = { item: NOTHING, depth: 0 };
  const square = (radius: number, items: Record<string, number>) =>
    Array.from({ length: (2 * radius + 1) ** 2 }, (_, pixel) => {
      const [right, up] = [
        (pixel % (2 * radius + 1)) - radius,
        Math.floor(pixel / (2 * radius + 1)) - radius,
      ];
      const depth = items[`${right},${up}`];
      return depth === undefined ? none : { item: 1, depth };
    });
  const met = metIn(square(4, { "3,0": 2, "0,-2": 9, "4,4": 1 }), 100, 50, 4);
  // The corner of the square is beyond the radius. Rows of the picture are counted from above.
  assert.deepEqual(met, [
    { x: 100.5, y: 52.5, depth: 9 },
    { x: 103.5, y: 50.5, depth: 2 },
  ]);
  assert.equal(leastOf(met, ({ x, y }) => Math.hypot(x - 100.5, y - 50.5))?.depth, 9);
  assert.equal(leastOf(met, ({ depth }) => depth)?.depth, 2);
  assert.equal(
    leastOf([], () => 0),
    undefined,
  );
});
