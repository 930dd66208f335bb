import assert from "node:assert/strict";
import { test } from "node:test";
import { MOST_PAINTS, NO_COLOURS } from "../src/draw/colours.ts";
import { cutPlanes, MOST_PLANES } from "../src/draw/cut.ts";
import { View } from "../src/draw/view.ts";
import { Gaze } from "../src/navigate/gaze.ts";
import { ObjectSet } from "../src/proto/objectSet.ts";
import type { Section } from "../src/proto/viewState.ts";
import type { Point } from "../src/space/point.ts";
import { KeptViewpoints, ViewpointsError } from "../src/tools/kept.ts";
import { pathJson } from "../src/tools/recording.ts";
import {
  boxAround,
  flipped,
  isCutAway,
  moved,
  planeFacing,
  replaced,
  resized,
} from "../src/tools/sections.ts";
import { decodeViewpoint, encodeViewpoint, foreign, type Viewpoint } from "../src/tools/viewpoint.ts";

const BOX: Section = { kind: "box", lower: [-1, -2, -3], upper: [1, 2, 3] };

test("a section cuts what lies beyond it, however the camera looks and however far out it is", () => {
  const far = 4e6;
  const sections: readonly Section[] = [
    { kind: "plane", point: [far + 1, 0, 0], direction: [0.5, 0, 0.5] },
    { kind: "box", lower: [far - 2, -2, -2], upper: [far + 3, 2, 2] },
  ];
  const eye: Point = [far - 4, 1, 2];
  const gaze = new Gaze([0.6, -0.3, -0.7]);
  const view = new View();
  const camera = { eye, orientation: gaze.orientation, tanHalfFov: 0.5, near: 0.1 };
  view.set(camera, 100, 100);
  const planes = cutPlanes(sections, view, camera);
  assert.equal(planes.length, 7 * 4);
  for (let x = -5; x <= 5; x += 0.77) {
    for (let z = -5; z <= 5; z += 0.77) {
      const y = 0.3 * x;
      const isCut = x - 1 + z > 0 || x < -2 || x > 3 || Math.abs(y) > 2 || Math.abs(z) > 2;
      const relative: Point = [far + x - eye[0], y - eye[1], z - eye[2]];
      const place = [0, 1, 2].map((axis) => view.along(axis, ...relative));
      const isBeyond = Array.from({ length: 7 }, (_, plane) => {
        const at = (axis: number) => (planes[4 * plane + axis] ?? 0) * (axis === 3 ? 1 : (place[axis] ?? 0));
        return at(0) + at(1) + at(2) + at(3) > 0;
      });
      assert.equal(isBeyond.includes(true), isCut, `${x} ${z}`);
    }
  }
  const six = Array.from({ length: 6 }, () => BOX);
  assert.equal(cutPlanes(six, view, camera).length, 4 * MOST_PLANES);
});

test("a plane faces the view along an axis, and is flipped and moved", () => {
  const plane = planeFacing([1, 2, 3], [0.1, -0.2, -0.9]);
  assert.deepEqual(plane, { kind: "plane", point: [1, 2, 3], direction: [0, 0, 1] });
  assert.deepEqual(flipped(plane), { kind: "plane", point: [1, 2, 3], direction: [0, 0, -1] });
  assert.deepEqual(moved({ ...plane, direction: [0, 0, 4] } as Section, 0.5), {
    kind: "plane",
    point: [1, 2, 3.5],
    direction: [0, 0, 4],
  });
});

test("a box has room around what it is for, and is never turned inside out", () => {
  const box = boxAround({ min: [0, 0, 0], max: [0, 0, 0] });
  assert.ok(box.kind === "box" && box.lower[0] < 0 && box.upper[2] > 0);
  assert.deepEqual(resized(BOX, "upper", 1, 5), { ...BOX, upper: [1, 5, 3] });
  for (const at of [-2, -9, Number.NaN]) {
    assert.deepEqual(resized(BOX, "upper", 1, at), BOX);
  }
  assert.deepEqual(replaced([BOX, box], 0, undefined), [box]);
  assert.deepEqual(replaced([BOX, box], 1, BOX), [BOX, BOX]);
});

const SCENE = { name: "Huldra åäö", fingerprint: "00e13c54a9b87d610f2233445566778a" };

const VIEWPOINT: Viewpoint = {
  scene: SCENE,
  eye: [1e6 + 1 / 3, -2, 0.1],
  forward: [0, 0.6, -0.8],
  vfovDeg: 55.5,
  mode: "orbit",
  view: {
    sections: [BOX, { kind: "plane", point: [0, 1, 0], direction: [0, 1, 0] }],
    hidden: ObjectSet.of([1, 2, 3, 700_000]),
    isolated: ObjectSet.run(5, 100_000),
    seeThrough: ObjectSet.EMPTY,
    distances: [
      { from: { point: [1e6, 0, 0.1], error: 0.02 }, to: { point: [1e6, 2, 0], error: undefined } },
    ],
    colouring: NO_COLOURS,
  },
};

/** The text of `VIEWPOINT` by a page without colours. */
const OLD =
  "A4p3ZlVEMyIPYX24qVQ84QANSHVsZHJhIMOlw6TDtgKrqqqqgIQuQQAAAAAAAADAmpmZmZmZuT8AAAAAAAAAADMzMzMzM-M_" +
  "mpmZmZmZ6b8AAAAAAMBLQAEAAAAAgIQuQQAAAAAAAAAAmpmZmZmZuT8BexSuR-F6lD8AAAAAgIQuQQAAAAAAAABAAAAAAAAA" +
  "AAAAAQEAAAAAAADwPwACAgEAAAAAAADwvwAAAAAAAADAAAAAAAAACMAAAAAAAADwPwAAAAAAAABAAAAAAAAACEAAAAAAAAAA" +
  "AAAAAAAAAADwPwAAAAAAAAAAAAAAAAAAAAAAAAAAAADwPwAAAAAAAAAAAgEC29wqAAEBBZqNBgEA";

test("a viewpoint is the same behind its text, which needs no quoting in an address", () => {
  const text = encodeViewpoint(VIEWPOINT);
  assert.match(text, /^[A-Za-z0-9_-]+$/);
  assert.ok(text.length < 400, `${text.length}`);
  assert.deepEqual(decodeViewpoint(text), VIEWPOINT);
  const whole = { ...VIEWPOINT, view: { ...VIEWPOINT.view, isolated: undefined } };
  assert.deepEqual(decodeViewpoint(encodeViewpoint(whole)), whole);
  for (const wrong of ["", "x", "äö", text.slice(0, -4), `${text}AAAA`, `AQ${text.slice(2)}`]) {
    assert.equal(decodeViewpoint(wrong), undefined, wrong);
  }
  // A count of distances too large for any memory.
  const bytes = [
    ...Array.from(atob(text.replaceAll("-", "+").replaceAll("_", "/")), (letter) => letter.charCodeAt(0)),
  ];
  assert.equal(bytes[88], 1, "a count of one distance");
  bytes.splice(88, 1, 255, 255, 255, 255, 255, 255, 255, 15);
  const many = btoa(String.fromCharCode(...bytes))
    .replaceAll("+", "-")
    .replaceAll("/", "_")
    .replaceAll("=", "");
  assert.equal(decodeViewpoint(many), undefined);
  const nowhere = encodeViewpoint({ ...VIEWPOINT, eye: [Number.NaN, 0, 0] });
  assert.equal(decodeViewpoint(nowhere), undefined);
});

test("a viewpoint has its colours, and one without is as it was before there were any", () => {
  const paint = { label: "Größe 5", colour: 0xffffff, objects: ObjectSet.of([0, 2, 9]) };
  const coloured = {
    ...VIEWPOINT,
    view: { ...VIEWPOINT.view, colouring: { by: "Size", paints: [paint, { ...paint, colour: 0 }] } },
  };
  const text = encodeViewpoint(coloured);
  assert.deepEqual(decodeViewpoint(text), coloured);
  assert.equal(encodeViewpoint(VIEWPOINT), OLD);
  assert.deepEqual(decodeViewpoint(OLD), VIEWPOINT);
  const wrong = (paints: readonly (typeof paint)[]) =>
    encodeViewpoint({ ...coloured, view: { ...coloured.view, colouring: { by: "", paints } } });
  assert.equal(decodeViewpoint(wrong([{ ...paint, colour: 1 << 24 }])), undefined);
  assert.equal(decodeViewpoint(wrong(Array.from({ length: MOST_PAINTS + 1 }, () => paint))), undefined);
  assert.equal(decodeViewpoint(text.slice(0, -4)), undefined);
});

test("a viewpoint may hide any number of objects", () => {
  // Every other one of a million: no two are adjacent.
  const hidden = ObjectSet.of(Array.from({ length: 500_000 }, (_, index) => 2 * index));
  const large = { ...VIEWPOINT, view: { ...VIEWPOINT.view, hidden } };
  assert.deepEqual(decodeViewpoint(encodeViewpoint(large)), large);
});

test("a viewpoint of another scene says which", () => {
  assert.equal(foreign(VIEWPOINT, SCENE), undefined);
  const other = { name: "city", fingerprint: "99e13c54a9b87d610f2233445566778a" };
  assert.match(foreign(VIEWPOINT, other) ?? "", /“Huldra åäö” .*00e13c54.* this is “city” .*99e13c54/);
  assert.match(foreign(VIEWPOINT, { ...other, name: SCENE.name }) ?? "", /has changed since/);
});

test("viewpoints are read from a file that is right, and a wrong one changes nothing and says why", () => {
  const kept = new KeptViewpoints(SCENE);
  kept.add({ name: "pump", thumbnail: "data:image/jpeg;base64,AA", viewpoint: VIEWPOINT });
  const json = kept.toJson();
  const other = new KeptViewpoints(SCENE);
  other.addJson(json);
  other.addJson(json);
  const [pump] = kept.list.value;
  assert.ok(pump);
  assert.deepEqual(other.list.value, [pump, { ...pump, name: "pump (2)" }]);
  const view = encodeViewpoint(VIEWPOINT);
  const foreignView = encodeViewpoint({ ...VIEWPOINT, scene: { name: "city", fingerprint: "9".repeat(32) } });
  for (const [wrong, why] of [
    ["{", /not JSON/],
    ["{}", /no list of views/],
    ["7", /no list of views/],
    ['[{"name":"a"}]', /view “a” needs a "name" and a "view"/],
    [`[{"name":"a","view":"${view}"},{"name":7,"view":"${view}"}]`, /view number 2 needs/],
    [`[{"name":"a","view":"${view.slice(4)}"}]`, /view “a” is damaged/],
    [`[{"name":"a","view":"${view}"},{"name":"b","view":"${foreignView}"}]`, /“b”: .*“city”.*“Huldra/],
    [`[${Array(201).fill("{}")}]`, /has 201 views: 200/],
    [`[${Array(199).fill(`{"name":"a","view":"${view}"}`)}]`, /more than 200/],
    ["[null]", /view number 1 needs/],
  ] as const) {
    assert.throws(
      () => other.addJson(wrong),
      (error) => error instanceof ViewpointsError && why.test(error.message),
      wrong.slice(0, 100),
    );
    assert.equal(other.list.value.length, 2);
  }
  other.addJson(`[{"name":"a","view":"${view}","thumbnail":"https://elsewhere/"}]`);
  assert.equal(other.list.value[2]?.thumbnail, "");
  const [first] = other.list.value;
  assert.ok(first);
  other.remove(first);
  assert.equal(other.list.value.length, 2);
});

test("sets are kept beside views, and files without them are read as before", () => {
  const kept = new KeptViewpoints(SCENE);
  kept.add({ name: "pump", thumbnail: "", viewpoint: VIEWPOINT });
  const before = kept.toJson();
  assert.deepEqual(JSON.parse(before), [{ name: "pump", thumbnail: "", view: OLD }]);
  assert.equal(kept.addSet("size > 100"), "size > 100");
  assert.equal(kept.addSet("size > 100"), "size > 100 (2)");
  assert.equal(kept.addSet("valve", " all valves "), "all valves");
  const [first, second] = kept.sets.value;
  assert.ok(first && second);
  kept.renameSet(first, "all valves");
  kept.renameSet(second, " ");
  kept.removeSet(second);
  const sets = [
    { name: "all valves (2)", query: "size > 100" },
    { name: "all valves", query: "valve" },
  ];
  assert.deepEqual(kept.sets.value, sets);
  const other = new KeptViewpoints(SCENE);
  other.addJson(kept.toJson());
  assert.deepEqual([other.sets.value, other.list.value], [sets, kept.list.value]);
  other.addJson(before);
  assert.deepEqual([other.sets.value, other.list.value.length], [sets, 2]);
  other.addJson('[{"name":"valves","query":""}]');
  assert.equal(other.sets.value.length, 3);
  for (const [wrong, why] of [
    ['[{"query":"a"}]', /set number 1 needs a "name"/],
    ['[{"name":" ","query":"a"}]', /set “ ” needs/],
    [`[{"name":"a","query":"${"x".repeat(2001)}"}]`, /at most 2000 letters/],
    ['[{"name":"a","query":7}]', /view “a” needs/],
    [`[${Array(201).fill('{"name":"a","query":"b"}')}]`, /has 201 sets: 200/],
    [`[${Array(199).fill('{"name":"a","query":"b"}')}]`, /199 sets there would be more than 200/],
  ] as const) {
    assert.throws(
      () => other.addJson(wrong),
      (error) => error instanceof ViewpointsError && why.test(error.message),
      wrong.slice(0, 100),
    );
    assert.deepEqual([other.sets.value.length, other.list.value.length], [3, 2]);
  }
});

test("no two viewpoints are called the same", () => {
  const kept = new KeptViewpoints(SCENE);
  const names = () => kept.list.value.map(({ name }) => name);
  const add = (name?: string) => kept.add({ ...(name && { name }), thumbnail: "", viewpoint: VIEWPOINT });
  add();
  add();
  add();
  const [first, second, third] = kept.list.value;
  assert.ok(first && second && third);
  kept.remove(second);
  add();
  assert.deepEqual(names(), ["View 1", "View 3", "View 4"]);
  kept.rename(first, "  pump ");
  kept.rename(third, "pump");
  assert.deepEqual(names(), ["pump", "pump (2)", "View 4"]);
  const [pump] = kept.list.value;
  assert.ok(pump);
  kept.rename(pump, " ");
  kept.rename(pump, "pump");
  assert.deepEqual(names(), ["pump", "pump (2)", "View 4"]);
});

test("a point beyond a section is cut away, and one on it is not", () => {
  const plane: Section = { kind: "plane", point: [0, 1, 0], direction: [0, 3, 0] };
  for (const [point, isCut] of [
    [[0, 1.01, 0], true],
    [[0, 1 + 1e-9, 0], false],
    [[0, 0.5, 0], false],
    [[1.01, 0.5, 0], true],
    [[1, 0.5, -3], false],
  ] as const) {
    assert.equal(isCutAway([BOX, plane], point), isCut, `${point}`);
  }
  assert.equal(isCutAway([], [9, 9, 9]), false);
});

test("a recorded walk is a camera path as the program reads it", () => {
  const poses = [
    { eye: [1, 2, 3], forward: [0, 0, -1] },
    { eye: [1, 2, 2], forward: [0, 0, -1] },
  ] as const;
  assert.equal(
    pathJson(60, poses),
    '{"vfov_deg":60,"frames":[{"eye":[1,2,3],"forward":[0,0,-1],"up":[0,1,0]},\n' +
      '{"eye":[1,2,2],"forward":[0,0,-1],"up":[0,1,0]}]}',
  );
});
