import assert from "node:assert/strict";
import { test } from "node:test";
import { Clashes, csvOf, groupsOf, metresOf, setsOf } from "../src/clearance/clashes.ts";
import { hide, showAll } from "../src/objects/actions.ts";
import type { Selection } from "../src/objects/selection.ts";
import { ObjectSet } from "../src/proto/objectSet.ts";
import type { Clash, Snapped } from "../src/service/service.ts";
import { angleAt, angleError, perpendicular } from "../src/tools/measures.ts";
import { decodeViewpoint } from "../src/tools/viewpoint.ts";
import type { Viewer } from "../src/viewer/viewer.ts";
import { ViewHistory, WHOLE } from "../src/viewer/viewHistory.ts";
import { navigatorAtOrigin } from "./atOrigin.ts";

const snapped = (point: Snapped["point"], more: Partial<Snapped> = {}): Snapped => ({
  to: "vertex",
  point,
  error: 1e-6,
  ...more,
});

test("an angle is that at the second point, small and large ones too", () => {
  assert.equal(
    angleAt([
      [1, 0, 0],
      [0, 0, 0],
      [0, 0, 5],
    ]),
    90,
  );
  assert.equal(
    angleAt([
      [1, 0, 0],
      [0, 0, 0],
      [-3, 0, 0],
    ]),
    180,
  );
  const small =
    angleAt([
      [1, 0, 0],
      [0, 0, 0],
      [1, 1e-9, 0],
    ]) ?? 0;
  assert.ok(Math.abs(small - (1e-9 * 180) / Math.PI) < 1e-20, `${small}`);
  assert.equal(
    angleAt([
      [1, 2, 3],
      [1, 2, 3],
      [0, 0, 5],
    ]),
    undefined,
  );
  const ends = [snapped([1, 0, 0]), snapped([0, 0, 0]), snapped([0, 0, 2])] as const;
  const error = angleError(ends) ?? 0;
  assert.ok(Math.abs(error - (3e-6 * 180) / Math.PI) < 1e-12, `${error}`);
  assert.equal(angleError([ends[0], snapped([0, 0, 0], { error: undefined }), ends[2]]), undefined);
});

test("the foot of a point is straight below it on the plane of a face", () => {
  const face = snapped([9, 9, 9], { face: { point: [100, 2, 7], normal: [0, -1, 0] } });
  const distance = perpendicular(snapped([1, 5, 3]), face);
  assert.deepEqual(distance?.to.point, [1, 2, 3]);
  assert.deepEqual(distance?.from.point, [1, 5, 3]);
  assert.equal(perpendicular(snapped([1, 5, 3]), snapped([9, 9, 9])), undefined);
  assert.equal(perpendicular(snapped([1, 5, 3]), snapped([9, 9, 9], { face: null })), undefined);
});

test("without a choice the sets are all objects, and all others", () => {
  const some = { label: "some", objects: ObjectSet.of([2, 3]) };
  const runs = (a: typeof some | undefined, b: typeof some | undefined) => {
    const { between, and } = setsOf(a, b, 6);
    return [between.pairs, and.pairs];
  };
  assert.deepEqual(runs(undefined, undefined), [[[0, 5]], [[0, 5]]]);
  assert.deepEqual(runs(some, undefined), [
    [[2, 1]],
    [
      [0, 1],
      [1, 1],
    ],
  ]);
  assert.deepEqual(runs(undefined, some), [[[0, 5]], [[2, 1]]]);
  assert.deepEqual(runs(some, some), [[[2, 1]], [[2, 1]]]);
  const set = ObjectSet.of([1, 2, 3, 9]);
  assert.deepEqual(ObjectSet.coded(set.pairs).runs, set.runs);
});

test("a tolerance is a number of millimetres", () => {
  assert.equal(metresOf("5"), 0.005);
  assert.equal(metresOf(" 0,5 "), 0.0005);
  assert.equal(metresOf("0"), 0);
  for (const wrong of ["", "-1", "5mm", "1e3", "NaN", "Infinity", "99999999999"]) {
    assert.equal(metresOf(wrong), undefined, wrong);
  }
});

/** The text that `a_link_is_what_the_page_reads` of `src/page/clash/view.rs` expects. */
const LINK =
  "AwEAAAAAAAAAAAAAAAAAAAAFYm94ZXMCAAAAAAAA8D8AAAAAAAAAQAAAAAAAAAhAAAAAAAAAAAAAAAAAAAAAAAAAAA" +
  "AAAPC_AAAAAAAATkABAAAAAAAA6D8AAAAAAAAAAAAAAAAAAAAAAY3ttaD3xqA-AAAAAAAA4D8AAAAAAAAAAAAAAAAA" +
  "AAAAAY3ttaD3xqA-gIAEgIAEAAAAAAAA8D8AAgAAAAECAQAAAA";

test("the view of a clash shows both objects, all others as ghosts, and the distance", () => {
  const view = decodeViewpoint(LINK);
  assert.deepEqual(view?.scene, { name: "boxes", fingerprint: "1".padStart(32, "0") });
  const { eye, forward, vfovDeg, mode } = view;
  assert.deepEqual([eye, forward, vfovDeg, mode], [[1, 2, 3], [0, 0, -1], 60, "orbit"]);
  assert.deepEqual([...view.view.seeThrough], [1, 3]);
  assert.deepEqual([view.view.hidden.size, view.view.isolated, view.view.sections], [0, undefined, []]);
  const ends = (["from", "to"] as const).map((end) => view.view.distances[0]?.[end]);
  assert.deepEqual(ends, [
    { point: [0.75, 0, 0], error: 5e-7 },
    { point: [0.5, 0, 0], error: 5e-7 },
  ]);
});

const clashOf = (first: number, second: number): Clash => ({
  kind: "hard",
  distance: 0,
  error: 0,
  parts: [
    { object: first, name: "", path: [] },
    { object: second, name: "", path: [] },
  ],
  points: [
    [0, 0, 0],
    [1, 0, 0],
  ],
  plant: [
    [0, 0, 0],
    [1, 0, 0],
  ],
  camera: { eye: [1, 2, 3], forward: [0, 0, -1], vfov_deg: 60 },
  view: "",
});

/** The clashes of a model of ten objects, and its views. */
function clashesOfTen(): { clashes: Clashes; view: ViewHistory } {
  const view = new ViewHistory(ObjectSet.of([9]));
  const { walker: navigator } = navigatorAtOrigin();
  const viewer = { view, navigator, scene: { objects: 10 } } as unknown as Viewer;
  const selection = { pickAll: () => undefined } as unknown as Selection;
  return { clashes: new Clashes(viewer, selection), view };
}

test("leaving the clashes gives back the view of before, with all that was measured meanwhile", () => {
  for (const rest of ["ghosts", "hidden"] as const) {
    const { clashes, view } = clashesOfTen();
    clashes.rest.value = rest;
    const measured = { from: { point: [0, 0, 0], error: 0 }, to: { point: [0, 2, 0], error: 0 } } as const;
    view.change({ hidden: ObjectSet.of([1, 5]), distances: [measured] });
    const before = view.current.value;
    clashes.show(clashOf(1, 2));
    clashes.show(clashOf(3, 4));
    assert.deepEqual([...view.current.value.hidden], [1, 5], "the first clash shows nothing any more");
    assert.equal(view.current.value.distances.length, 2);
    clashes.leave();
    assert.deepEqual(view.current.value, before, rest);
    // Once is enough, and one step undoes it.
    clashes.leave();
    view.undo();
    assert.deepEqual([...(view.current.value.isolated ?? ObjectSet.of([3, 4]))], [3, 4]);
    clashes.leave();
    assert.deepEqual(view.current.value, before, rest);
  }
});

test("the clashes take nothing away that a person has hidden, or shown again", () => {
  const { clashes, view } = clashesOfTen();
  clashes.leave();
  assert.ok(!view.canUndo.value, "without a clash there is nothing to give back");
  clashes.show(clashOf(1, 2));
  view.change(hide(view.current.value, ObjectSet.of([7])));
  clashes.leave();
  assert.deepEqual([...view.current.value.hidden], [7]);
  assert.deepEqual([...view.current.value.seeThrough], [9]);
  clashes.show(clashOf(1, 2));
  view.change(showAll(view.current.value, view.modelSeeThrough));
  const all = view.current.value;
  assert.deepEqual(all, { ...WHOLE, seeThrough: view.modelSeeThrough }, "the distance is gone as well");
  clashes.leave();
  assert.equal(view.current.value, all);
});

test("a clash is a line of comma-separated values", () => {
  const clash: Clash = {
    kind: "clearance",
    distance: 0.0125,
    error: 2e-6,
    parts: [
      { object: 2, name: 'FLANGE 1 of BRANCH, or\n"not"', path: ["plant.RVM", "/ZONE-1"] },
      { object: 5, name: "", path: [] },
    ],
    points: [
      [0, 0, 0],
      [0.0125, 0, 0],
    ],
    plant: [
      [100, 200, 30],
      [100.0125, 200, 30],
    ],
    camera: { eye: [1, 2, 3], forward: [0, 0, -1], vfov_deg: 60 },
    view: "#v=x",
  };
  const [head, ...lines] = csvOf([clash]).split("\n");
  assert.equal(head?.split(",").length, 22);
  const expected =
    'clearance,0.012500,2.0e-6,"FLANGE 1 of BRANCH, or\n""not""",plant.RVM > /ZONE-1,2,,,5,' +
    "0.000000,0.000000,0.000000,0.012500,0.000000,0.000000," +
    "100.000000,200.000000,30.000000,100.012500,200.000000,30.000000,#v=x\n";
  assert.equal(lines.join("\n"), expected);
  const [, last] = csvOf([], { count: 3, level: "part" }).split("\n");
  assert.equal(last, `ignored,,,3 in the same part${",".repeat(18)}`);
});

test("clashes are grouped by the groups of both objects, in either order", () => {
  const clash = (object: number, first: readonly string[], second: readonly string[]): Clash => ({
    kind: "hard",
    distance: 0,
    error: 0,
    parts: [
      { object, name: "", path: ["a.rvm", ...first] },
      { object: 9, name: "box", path: ["a.rvm", ...second] },
    ],
    points: [
      [0, 0, 0],
      [0, 0, 0],
    ],
    plant: [
      [0, 0, 0],
      [0, 0, 0],
    ],
    camera: { eye: [1, 2, 3], forward: [0, 0, -1], vfov_deg: 60 },
    view: "",
  });
  const clashes = [
    clash(1, ["S", "A", "", "P"], ["S", "B"]),
    clash(2, ["S", "B"], ["S", "A", "Q"]),
    clash(3, [], ["S", "B"]),
  ];
  const groups = (level: "Part" | "Equipment" | "System") =>
    groupsOf(clashes, level).map((group) => [group.paths.join("|"), group.clashes.length]);
  assert.deepEqual(groups("Part"), [
    ["a.rvm > S > A >  > P|a.rvm > S > B", 1],
    ["a.rvm > S > B|a.rvm > S > A > Q", 1],
    ["a.rvm > object 3|a.rvm > S > B", 1],
  ]);
  assert.deepEqual(groups("Equipment"), [
    ["a.rvm > S > A|a.rvm > S", 2],
    ["a.rvm > object 3|a.rvm > S", 1],
  ]);
  assert.deepEqual(
    groupsOf(clashes, "System").map(({ names }) => names),
    [
      ["S", "S"],
      ["object 3", "S"],
    ],
  );
});
