import assert from "node:assert/strict";
import { test } from "node:test";
import { cutPlanes, MOST_PLANES } from "../src/draw/cut.ts";
import { View } from "../src/draw/view.ts";
import { Gaze } from "../src/navigate/gaze.ts";
import { ObjectSet } from "../src/proto/objectSet.ts";
import type { Point, Section } from "../src/proto/viewState.ts";
import { KeptViewpoints, ViewpointsError } from "../src/tools/kept.ts";
import { pathJson } from "../src/tools/recording.ts";
import { boxAround, flipped, moved, planeFacing, replaced, resized } from "../src/tools/sections.ts";
import { decodeViewpoint, encodeViewpoint, type Viewpoint } from "../src/tools/viewpoint.ts";

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
  const box = boxAround([0, 0, 0], [0, 0, 0]);
  assert.ok(box.kind === "box" && box.lower[0] < 0 && box.upper[2] > 0);
  assert.deepEqual(resized(BOX, "upper", 1, 5), { ...BOX, upper: [1, 5, 3] });
  for (const at of [-2, -9, Number.NaN]) {
    assert.deepEqual(resized(BOX, "upper", 1, at), BOX);
  }
  assert.deepEqual(replaced([BOX, box], 0, undefined), [box]);
  assert.deepEqual(replaced([BOX, box], 1, BOX), [BOX, BOX]);
});

const VIEWPOINT: Viewpoint = {
  eye: [1e6 + 1 / 3, -2, 0.1],
  forward: [0, 0.6, -0.8],
  vfovDeg: 55.5,
  view: {
    sections: [BOX, { kind: "plane", point: [0, 1, 0], direction: [0, 1, 0] }],
    hidden: ObjectSet.of([1, 2, 3, 700_000]),
    isolated: ObjectSet.run(5, 100_000),
    seeThrough: ObjectSet.EMPTY,
  },
  distances: [{ from: [1e6, 0, 0.1], to: [1e6, 2, 0] }],
};

test("a viewpoint is the same behind its text, which needs no quoting in an address", () => {
  const text = encodeViewpoint(VIEWPOINT);
  assert.match(text, /^[A-Za-z0-9_-]+$/);
  assert.ok(text.length < 400, `${text.length}`);
  assert.deepEqual(decodeViewpoint(text), VIEWPOINT);
  const whole = { ...VIEWPOINT, view: { ...VIEWPOINT.view, isolated: undefined } };
  assert.deepEqual(decodeViewpoint(encodeViewpoint(whole)), whole);
  for (const wrong of ["", "x", "äö", text.slice(0, -4), `${text}AAAA`, `C${text.slice(1)}`]) {
    assert.equal(decodeViewpoint(wrong), undefined, wrong);
  }
  // A count of distances that no memory holds.
  const bytes = [
    ...Array.from(atob(text.replaceAll("-", "+").replaceAll("_", "/")), (letter) => letter.charCodeAt(0)),
  ];
  bytes.splice(57, 1, 255, 255, 255, 255, 255, 255, 255, 15);
  const many = btoa(String.fromCharCode(...bytes))
    .replaceAll("+", "-")
    .replaceAll("/", "_")
    .replaceAll("=", "");
  assert.equal(decodeViewpoint(many), undefined);
  const nowhere = encodeViewpoint({ ...VIEWPOINT, eye: [Number.NaN, 0, 0] });
  assert.equal(decodeViewpoint(nowhere), undefined);
});

test("a viewpoint may hide any number of objects", () => {
  // Every other one of a million: they make no runs.
  const hidden = ObjectSet.of(Array.from({ length: 500_000 }, (_, index) => 2 * index));
  const large = { ...VIEWPOINT, view: { ...VIEWPOINT.view, hidden } };
  assert.deepEqual(decodeViewpoint(encodeViewpoint(large)), large);
});

test("viewpoints are read from a file that is right, and a wrong one changes nothing", () => {
  const kept = new KeptViewpoints("0");
  kept.add({ name: "pump", thumbnail: "data:image/jpeg;base64,AA", viewpoint: VIEWPOINT });
  const json = kept.toJson();
  const other = new KeptViewpoints("1");
  other.addJson(json);
  other.addJson(json);
  assert.deepEqual(other.list.value, [...kept.list.value, ...kept.list.value]);
  const view = encodeViewpoint(VIEWPOINT);
  for (const [wrong, why] of [
    ["{", /no JSON/],
    ["{}", /a list/],
    ['[{"name":"a"}]', /viewpoint 0/],
    [`[{"name":"a","view":"${view}"},{"name":7,"view":"${view}"}]`, /viewpoint 1/],
    [`[${Array(201).fill("{}")}]`, /at most 200/],
    ["[null]", /viewpoint 0/],
  ] as const) {
    assert.throws(
      () => other.addJson(wrong),
      (error) => error instanceof ViewpointsError && why.test(error.message),
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
