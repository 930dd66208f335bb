import assert from "node:assert/strict";
import { test } from "node:test";
import {
  ghostRest,
  hide,
  isolate,
  show,
  showAll,
  toggleSeeThrough,
  told,
  visibility,
} from "../src/objects/actions.ts";
import { atLevel, LEVELS, levelsOf, parentOf } from "../src/objects/levels.ts";
import { ObjectSet } from "../src/proto/objectSet.ts";
import type { PartDetails } from "../src/service/service.ts";
import { around } from "../src/space/box.ts";
import { lengthText, measuredText } from "../src/tools/lengths.ts";
import { hasGhosts, ViewHistory, WHOLE } from "../src/viewer/viewHistory.ts";

/** All sets of some numbers below 12. */
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
      assert.equal(a.equals(b), left.join() === right.join());
      assert.equal(a.isApartFrom(b), !right.some((object) => left.includes(object)));
    }
    assert.equal(a.size, [...a].length);
    assert.equal(a.equals(undefined), false);
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
  assert.equal(told(view, 100), "only 9 shown, 2 hidden");
  view = { ...view, ...toggleSeeThrough(view, pipe) };
  assert.ok(view.seeThrough.has(3));
  view = { ...view, ...toggleSeeThrough(view, pipe) };
  assert.ok(view.seeThrough.isEmpty);
  const plane = { kind: "plane", point: [0, 0, 0], direction: [0, 1, 0] } as const;
  view = { ...view, sections: [plane] };
  assert.equal(told(view, 100), "cut by 1 section, only 9 shown, 2 hidden");
  view = { ...view, ...showAll(view) };
  assert.deepEqual([drawn(), told(view, 100)], [["all", "all", "all"], ""]);
});

test("all the rest are ghosts, and what the model has see-through stays so", () => {
  const [model, pipe] = [ObjectSet.run(0, 2), ObjectSet.run(1, 4)];
  const ghosts = { ...WHOLE, ...ghostRest(pipe, 10, model) };
  assert.deepEqual([...ghosts.seeThrough], [0, 1, 4, 5, 6, 7, 8, 9]);
  assert.equal(told(ghosts, 10, model), "ghosts: all but 2");
  const few = { ...WHOLE, seeThrough: ObjectSet.run(0, 4) };
  assert.equal(told(few, 10, model), "4 see-through");
  // A model of glass has no ghosts until somebody makes some.
  const glass = { ...WHOLE, seeThrough: ObjectSet.run(0, 9) };
  assert.deepEqual([hasGhosts(glass, 10, glass.seeThrough), hasGhosts(glass, 10)], [false, true]);
});

test("a level is the lowest named group or one above it, and never the file", () => {
  const group = (id: number, name: string, first: number, end: number) =>
    ({ kind: "group", id, name, first, end }) as const;
  const path = [
    group(0, "plant.rvm", 0, 99),
    group(1, "ZONE", 0, 50),
    group(2, "", 0, 20),
    group(3, "PIPE", 0, 20),
    group(4, "BRANCH", 0, 20),
    group(5, "", 3, 9),
  ];
  const object = { kind: "object", id: 5, name: "", first: 5, end: 6, path } as unknown as PartDetails;
  const names = LEVELS.map((level) => atLevel(object, level).name);
  assert.deepEqual(names, ["", "BRANCH", "PIPE", "ZONE"]);
  const shallow = { ...object, path: path.slice(0, 2) };
  assert.deepEqual(
    LEVELS.map((level) => atLevel(shallow, level).name),
    ["", "ZONE", "ZONE", "ZONE"],
  );
  assert.equal(atLevel({ ...object, path: path.slice(0, 1) }, "System").kind, "object");
  // Groups of the same objects are one step.
  assert.equal(parentOf(object)?.name, "BRANCH");
  const branch = { ...object, first: 0, end: 20, path: path.slice(0, 4) };
  assert.equal(parentOf(branch)?.name, "ZONE");
  assert.equal(parentOf({ ...branch, end: 99, path: [] }), undefined);
  assert.deepEqual(levelsOf({ groupLevels: 2 }), ["Primitive", "Part", "Equipment"]);
  assert.deepEqual([levelsOf({ groupLevels: 0 }).length, levelsOf({ groupLevels: 9 }).length], [1, 4]);
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

test("lengths are of whole millimetres, and small ones finer", () => {
  const lengths = [12.345, 101.26, 12.3456, 1, 0.0754, 8.77e-6, 0, -1.25];
  assert.deepEqual(
    lengths.map((length) => lengthText(length, "m")),
    ["12.345 m", "101.260 m", "12.346 m", "1.000 m", "0.075 m", "0.00001 m", "0.000 m", "-1.250 m"],
  );
  assert.deepEqual(
    lengths.map((length) => lengthText(length, "mm")),
    ["12345 mm", "101260 mm", "12346 mm", "1000 mm", "75 mm", "0.01 mm", "0 mm", "-1250 mm"],
  );
  assert.deepEqual(
    [0.3048, 12.345, 0.0254, 0.30479999, 0, 0.00254].map((length) => lengthText(length, "ft-in")),
    ["1' 0.00\"", "40' 6.02\"", '1.00"', "1' 0.00\"", '0.00"', '0.1000"'],
  );
});

test("what a length may be off is said, where it is half of the last digit or more", () => {
  assert.equal(measuredText(12.345, 0, "m"), "12.345 m");
  assert.equal(measuredText(12.345, 0.000_49, "m"), "12.345 m");
  assert.equal(measuredText(12.345, 0.0371, "m"), "12.345 m ± 0.038 m");
  assert.equal(measuredText(12.345, 0.0371, "mm"), "12345 mm ± 38 mm");
  assert.equal(measuredText(12.345, undefined, "m"), "about 12.345 m");
  // With the digits of the length, rounded up.
  assert.equal(measuredText(9.157, 0.0052, "m"), "9.157 m ± 0.006 m");
  assert.equal(measuredText(9.157, 0.006, "m"), "9.157 m ± 0.006 m");
  assert.equal(measuredText(9.157, 0.0005, "mm"), "9157 mm ± 1 mm");
  assert.equal(measuredText(0.3048, 0.008_97, "ft-in"), '1\' 0.00" ± 0.36"');
  assert.equal(measuredText(0.005, 0.0371, "m"), "0.00500 m ± 0.03710 m");
  assert.equal(measuredText(0.005, 0.000_121, "mm"), "5.00 mm ± 0.13 mm");
  assert.equal(measuredText(0.005, 0.000_004, "mm"), "5.00 mm");
});

test("a change of what is measured is a step, and what is corrected of it is none", () => {
  const history = new ViewHistory();
  const end = (x: number, error: number) => ({ point: [x, 0, 0] as const, error });
  const [coarse, fine] = [end(1, 0.5), end(2, 0)];
  const seen = history.seen.value;
  history.change({ distances: [{ from: coarse, to: end(3, 0) }] });
  history.change({ distances: [] });
  history.amend(({ distances }) => ({
    distances: distances.map((one) => (one.from === coarse ? { ...one, from: fine } : one)),
  }));
  assert.equal(history.seen.value, seen, "a culler is not told");
  history.undo();
  assert.deepEqual(history.current.value.distances, [{ from: fine, to: end(3, 0) }]);
  history.undo();
  assert.deepEqual([history.current.value.distances, history.canUndo.value], [[], false]);
  history.change({ hidden: ObjectSet.of([1]) });
  assert.notEqual(history.seen.value, seen);
});

test("a view begins with what the model has see-through, and all is shown as the model has it", () => {
  const glass = ObjectSet.coded([
    [2, 1],
    [0, 0],
    [4, 0],
  ]);
  assert.deepEqual(
    [...glass.runs],
    [
      { first: 2, end: 4 },
      { first: 5, end: 6 },
      { first: 11, end: 12 },
    ],
  );
  assert.deepEqual(ObjectSet.coded([]), ObjectSet.EMPTY);
  const history = new ViewHistory(glass);
  assert.equal(history.seen.value.seeThrough, glass);
  history.change({ seeThrough: ObjectSet.EMPTY, hidden: ObjectSet.of([1]) });
  history.change(showAll(history.current.value, history.modelSeeThrough));
  assert.deepEqual(history.current.value, { ...WHOLE, seeThrough: glass });
});

test("the box around parts is around each", () => {
  assert.equal(around([]), undefined);
  const one = { min: [0, 1, 2], max: [3, 4, 5] } as const;
  const two = { min: [-1, 2, 2], max: [2, 9, 4] } as const;
  assert.deepEqual(around([one]), one);
  assert.deepEqual(around([one, two]), { min: [-1, 1, 2], max: [3, 9, 5] });
});
