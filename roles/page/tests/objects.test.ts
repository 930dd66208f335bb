import assert from "node:assert/strict";
import { test } from "node:test";
import { hide, isolate, show, showAll, toggleSeeThrough, told, visibility } from "../src/objects/actions.ts";
import { metres } from "../src/objects/detailsPanel.tsx";
import { ObjectSet } from "../src/proto/objectSet.ts";
import { ViewHistory, WHOLE } from "../src/viewer/viewHistory.ts";

/** Numbers below 12, each in or not. */
function* sets(): Generator<ObjectSet> {
  for (let bits = 0; bits < 1 << 12; bits += 37) {
    yield ObjectSet.of(
      Array.from({ length: 12 }, (_, object) => object).filter((object) => bits & (1 << object)),
    );
  }
}

test("sets are joined and taken from each other as lists of numbers are", () => {
  for (const a of sets()) {
    for (const b of sets()) {
      const [left, right] = [[...a], [...b]];
      assert.deepEqual(a.union(b), ObjectSet.of([...left, ...right]));
      assert.deepEqual(a.minus(b), ObjectSet.of(left.filter((object) => !right.includes(object))));
      assert.equal(
        a.covers(b),
        right.every((object) => left.includes(object)),
      );
    }
    assert.equal(a.size, [...a].length);
  }
  assert.deepEqual(ObjectSet.run(3, 6), ObjectSet.of([3, 4, 5]));
  assert.ok(ObjectSet.run(3, 3).isEmpty);
});

test("what is hidden, isolated and shown again is drawn or not", () => {
  const [zone, pipe, other] = [ObjectSet.run(0, 10), ObjectSet.run(2, 4), ObjectSet.run(20, 21)];
  let view = { ...WHOLE, ...hide(WHOLE, pipe) };
  const drawn = () => [zone, pipe, other].map((objects) => visibility(view, objects));
  assert.deepEqual(drawn(), ["some", "none", "all"]);
  view = { ...view, ...isolate(view, zone) };
  assert.deepEqual(drawn(), ["all", "all", "none"]);
  view = { ...view, ...hide(view, pipe) };
  assert.deepEqual(drawn(), ["some", "none", "none"]);
  view = { ...view, ...show(view, other) };
  assert.deepEqual(drawn(), ["some", "none", "all"]);
  assert.equal(told(view), "only 9 shown, 2 hidden");
  view = { ...view, ...toggleSeeThrough(view, pipe) };
  assert.ok(view.seeThrough.has(3));
  view = { ...view, ...toggleSeeThrough(view, pipe) };
  assert.ok(view.seeThrough.isEmpty);
  view = { ...view, ...showAll() };
  assert.deepEqual([drawn(), told(view)], [["all", "all", "all"], ""]);
});

test("changes are taken back one by one, and a drag is one", () => {
  const history = new ViewHistory();
  const hidden = () => [...history.current.value.hidden];
  const change = (...objects: number[]) => ({ hidden: ObjectSet.of(objects) });
  history.change(change(1));
  history.drag(change(2));
  history.drag(change(3));
  history.change(change(4));
  assert.deepEqual(hidden(), [4]);
  history.undo();
  assert.deepEqual([hidden(), history.canRedo.value], [[1], true]);
  history.redo();
  assert.deepEqual([hidden(), history.canRedo.value], [[4], false]);
  history.undo();
  history.undo();
  history.undo();
  assert.deepEqual([hidden(), history.canUndo.value], [[], false]);
  history.change(change(5));
  assert.deepEqual([hidden(), history.canRedo.value], [[5], false]);
  for (let object = 0; object < 1000; object += 1) {
    history.change(change(object));
  }
  let steps = 0;
  for (; history.canUndo.value; steps += 1) {
    history.undo();
  }
  assert.equal(steps, 100);
});

test("lengths have three digits, in metres or millimetres", () => {
  assert.deepEqual([12.3456, 1, 0.0754, 8.77e-6, 0].map(metres), [
    "12.3 m",
    "1 m",
    "75.4 mm",
    "0.01 mm",
    "0 mm",
  ]);
});
