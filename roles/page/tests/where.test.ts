import assert from "node:assert/strict";
import { test } from "node:test";
import type { Section } from "../src/proto/viewState.ts";
import {
  alongAxis,
  bearingOf,
  inPlant,
  type PlantFrame,
  toPlant,
  toScene,
  wayToPlant,
  wayToScene,
} from "../src/space/plantFrame.ts";
import { distance, minus, type Point, pointOf } from "../src/space/point.ts";
import { errorText, gazeText, placeText, rangeTexts, wayText } from "../src/tools/coordinates.ts";
import { CoordinatesError, coordinatesOf } from "../src/tools/coordinatesInput.ts";
import { facesOf, planeText } from "../src/tools/faces.ts";
import { coordinateText, UNITS } from "../src/tools/lengths.ts";
import { resized } from "../src/tools/sections.ts";

const PLAIN: PlantFrame = { origin: [0, 0, 0], north_deg: 0 };

/** Numbers that are the same in each run: Park and Miller's generator. */
function randomOf(seed: number): (least: number, most: number) => number {
  let state = seed;
  return (least, most) => {
    state = (state * 48271) % 2147483647;
    return least + (state / 2147483647) * (most - least);
  };
}

function isNear(a: Point, b: Point, within: number): void {
  assert.ok(distance(a, b) <= within, `${a} is not ${b}`);
}

test("x is east and -z is north, north turns clockwise, and the origin shifts", () => {
  assert.deepEqual(toPlant(PLAIN, [1, 2, 3]), [1, -3, 2]);
  // The same cases as of `PlantFrame` in Rust.
  const frame: PlantFrame = { origin: [1e6, 2e6, 30], north_deg: 90 };
  assert.deepEqual(toPlant(frame, [5, 7, 0]), [1e6, 2e6 + 5, 37]);
  assert.deepEqual(toPlant(frame, [0, 0, 3]), [1e6 + 3, 2e6, 30]);
  assert.deepEqual(wayToScene(frame, [0, 1, 0]), [1, 0, 0]);
});

test("coordinates lead back to their points, also ten thousand kilometres away", () => {
  const random = randomOf(7);
  for (let count = 0; count < 2000; count += 1) {
    const far = (most: number): Point => pointOf(() => random(-most, most));
    const frame: PlantFrame = { origin: far(1e7), north_deg: random(-360, 360) };
    // A model about its own origin, and one in its country's coordinates.
    for (const [a, b] of [
      [far(1e3), far(1e3)],
      [far(1e7), far(1e7)],
    ] as const) {
      const [p, q] = [toPlant(frame, a), toPlant(frame, b)];
      isNear(toScene(frame, p), a, 1e-6);
      isNear(toPlant(frame, toScene(frame, b)), b, 1e-6);
      assert.ok(Math.abs(distance(p, q) - distance(a, b)) < 1e-6);
      assert.ok(Math.abs(p[2] - q[2] - (a[1] - b[1])) < 1e-6);
      isNear(wayToPlant(frame, minus(b, a)), minus(q, p), 1e-6);
    }
  }
});

test("a box is around its points in any frame, and tight where the axes agree", () => {
  const random = randomOf(11);
  for (let count = 0; count < 500; count += 1) {
    const frame: PlantFrame = { origin: [1e5, -2e5, 7], north_deg: random(-360, 360) };
    const min: Point = pointOf(() => random(-100, 100));
    const max: Point = pointOf((axis) => min[axis] + random(0, 50));
    const box = inPlant(frame, { min, max });
    const inside = toPlant(
      frame,
      pointOf((axis) => random(min[axis], max[axis])),
    );
    assert.ok(inside.every((at, axis) => at >= (box.min[axis] ?? 0) && at <= (box.max[axis] ?? 0)));
  }
  const box = inPlant({ origin: [100, 200, 300], north_deg: 180 }, { min: [1, 2, 3], max: [4, 6, 8] });
  assert.deepEqual(box, { min: [96, 203, 302], max: [99, 208, 306] });
});

test("right angles keep axes exact, others have none in common", () => {
  const along = (north_deg: number) =>
    ([0, 1, 2] as const).map((axis) => {
      const found = alongAxis({ origin: [0, 0, 0], north_deg }, axis);
      return found && `${found.rises ? "+" : "-"}${"ENU"[found.of]}`;
    });
  assert.deepEqual(along(0), ["+E", "+U", "-N"]);
  assert.deepEqual(along(90), ["+N", "+U", "+E"]);
  assert.deepEqual(along(-180), ["-E", "+U", "+N"]);
  assert.deepEqual(along(270), ["-N", "+U", "-E"]);
  assert.deepEqual(along(30), [undefined, "+U", undefined]);
});

test("bearings are clockwise from north", () => {
  assert.equal(bearingOf(PLAIN, [0, 0, -2]), 0);
  assert.equal(bearingOf(PLAIN, [3, 9, 0]), 90);
  assert.equal(bearingOf(PLAIN, [-1, 0, 0]), 270);
  assert.equal(bearingOf(PLAIN, [0, 1, 0]), undefined);
  assert.equal(bearingOf({ origin: [5, 5, 5], north_deg: 90 }, [1, 0, 0]), 0);
  assert.equal(gazeText(PLAIN, [Math.SQRT1_2, 0, Math.SQRT1_2]), "SE 135°, level");
  assert.equal(gazeText(PLAIN, [0, -0.5, -Math.sqrt(0.75)]), "N 000°, 30° down");
  assert.equal(gazeText(PLAIN, [-0.003, 0.6, -0.8]), "N 000°, 37° up");
});

test("coordinates have whole millimetres in each unit, and zero no sign", () => {
  const frame: PlantFrame = { origin: [10_000_000, 0, 0], north_deg: 0 };
  const point: Point = [0.0014, -0.0004, -0.3048];
  assert.equal(placeText(frame, point, "m"), "E 10000000.001 m, N 0.305 m, U 0.000 m");
  assert.equal(placeText(frame, point, "mm"), "E 10000000001 mm, N 305 mm, U 0 mm");
  assert.equal(placeText(PLAIN, [0, 0.0254, -0.6096], "ft-in"), `E 0.00", N 2' 0.00", U 1.00"`);
  assert.equal(wayText(frame, [1, -2.5, -3], "m"), "dE 1.000 m, dN 3.000 m, dU -2.500 m");
  assert.equal(coordinateText(-0.0006, "m"), "-0.001 m");
  assert.deepEqual(rangeTexts(PLAIN, { min: [1, 2, 3], max: [4, 5, 6] }, "mm"), [
    "E 1000 mm to 4000 mm",
    "N -6000 mm to -3000 mm",
    "U 2000 mm to 5000 mm",
  ]);
  assert.equal(errorText({ error: 0 }, "m"), "");
  assert.equal(errorText({ error: 0.02 }, "m"), " ± 0.020 m");
  assert.equal(errorText({ error: undefined }, "m"), " (about)");
});

/** Texts of one and the same point. */
const SAME = [
  "E 1234.5 N 678.9 U 10",
  "1234.5 678.9 10",
  "1234.5,678.9,10",
  "1234.5, 678.9, 10",
  "1234.5;678.9;10",
  "1234,5; 678,9; 10,0",
  "1234,5 678,9 10,0",
  "1234.5\t678.9\t10\n",
  "E1234.5 N678.9 U10",
  "e: 1234.5, n: 678.9, u: 10",
  "E=1234.5 N=678.9 U=10",
  "(1234.5 | 678.9 | 10)",
  "U 10 N 678.9 E 1234.5",
  "x 1234.5 y 678.9 z 10",
  "Easting 1234.5 Northing 678.9 Elevation 10",
  "1234.5E 678.9N 10U",
  "1234.5 m E, 678.9 m N, 10 m U",
  "E 1234.5 m, N 678.9 m, U 10.000 m",
  "E 1234500mm N 678900mm U 10000mm",
  "E 1234500 N 678900 U 10000 mm",
  "W -1234500mm S -678900mm D -10000mm",
  "E 123450 cm N 678.9 m U 10000 mm",
  "E 1,234.5 N 678.9 U 10",
  "E 1.234,5 N 678,9 U 10",
  "+1234.5 +678.9 +10.",
  `E 4050' 2.3622047" N 2227' 4.3464567" U 32' 9.7007874"`,
  "4050.19685039 ft 2227.36220472 ft 32.80839895 ft",
];

test("coordinates are read as people paste them", () => {
  for (const text of SAME) {
    isNear(coordinatesOf(text, "m"), [1234.5, 678.9, 10], 1e-6);
  }
  assert.deepEqual(coordinatesOf("W 12345 S 7 D 2", "m"), [-12345, -7, -2]);
  assert.deepEqual(coordinatesOf("−1.5 0 .25", "m"), [-1.5, 0, 0.25]);
  // Without a unit it is that of the page.
  isNear(coordinatesOf("1234500 678900 10000", "mm"), [1234.5, 678.9, 10], 1e-9);
  isNear(coordinatesOf("10 20 30", "ft-in"), [3.048, 6.096, 9.144], 1e-12);
  isNear(coordinatesOf(`-10' 6" 0' 1" 2"`, "m"), [-3.2004, 0.0254, 0.0508], 1e-12);
  isNear(coordinatesOf("1,234,567 2,345,678 1,234.5", "m"), [1_234_567, 2_345_678, 1234.5], 1e-9);
  assert.deepEqual(coordinatesOf("1,2,3", "m"), [1, 2, 3]);
  // Three numbers by their commas alone.
  assert.deepEqual(coordinatesOf("1,234,567", "m"), [1, 234, 567]);
});

test("what the page writes is read back", () => {
  const random = randomOf(23);
  for (const unit of UNITS) {
    for (let count = 0; count < 300; count += 1) {
      const point: Point = pointOf(() => random(-1e7, 1e7) / 10 ** Math.floor(random(0, 9)));
      const frame: PlantFrame = { origin: pointOf(() => random(-1e7, 1e7)), north_deg: random(0, 360) };
      const back = toScene(frame, coordinatesOf(placeText(frame, point, unit), "m"));
      isNear(back, point, unit === "ft-in" ? 0.0003 : 0.00087);
    }
  }
});

test("a text that is not understood is told precisely", () => {
  const fault = (text: string): string => {
    try {
      return `none: ${coordinatesOf(text, "m")}`;
    } catch (error) {
      assert.ok(error instanceof CoordinatesError, `${text}: ${error}`);
      return error.message;
    }
  };
  const cases = {
    "": "Type coordinates, such as E 1234.5 N 678.9 U 10.",
    " \t ": "Type coordinates, such as E 1234.5 N 678.9 U 10.",
    "12": "That is one number: it takes three, for E, N and U.",
    "12 13": "These are 2 numbers: it takes three, for E, N and U.",
    "1 2 3 4": "These are 4 numbers: it takes three, for E, N and U.",
    "E 1 U 2": "N is missing.",
    "E 1 W 2 U 3": "E is given twice.",
    "E 1 2 U 3": "2 has no letter: give all three one, or none.",
    "E N 2 U 3": "E has no number.",
    "E 1 N 2 U": "U has no number.",
    "1 E E 2 N": "E has no number.",
    "P-101 5 6": "“P” is neither a direction nor a unit.",
    "E 12q N 2 U 3": "“q” is neither a direction nor a unit.",
    "1 % 2": "“%” is not understood.",
    "1 2 😀": "“😀” is not understood.",
    "1.2.3 4 5": "1.2.3 is no number.",
    "E 1,234 N 2 U 3": "1,234 may be 1.234 or 1234: leave the comma out.",
    "E 1 m N 2 m U 3": "3 has no unit, and others have one.",
    "E mm 1 N 2 U 3": "“mm” stands behind no number.",
    "1 mm mm 2 3": "“mm” stands behind no number.",
    "1 2 9999999999999": "9999999999999 is too far away.",
    NaN: "“NaN” is neither a direction nor a unit.",
    Infinity: "“Infinity” is neither a direction nor a unit.",
  };
  for (const [text, expected] of Object.entries(cases)) {
    assert.equal(fault(text), expected, text);
  }
  assert.equal(fault(`1 2 ${"9".repeat(400)}`), "That is too long: at most 200 letters.");
  assert.equal(fault(`1 2 ${"9".repeat(150)}`), `${"9".repeat(150)} is too far away.`);
  // Any text at all has an answer or an error of this kind.
  const random = randomOf(5);
  const signs = "0123456789.,;:' \"\t\n-+−enuwsdxyzmft()€é";
  for (let count = 0; count < 5000; count += 1) {
    const text = Array.from({ length: random(0, 30) }, () => signs[Math.floor(random(0, signs.length))]);
    fault(text.join(""));
  }
});

test("faces of sections have the plant's coordinates, and are moved by them", () => {
  const box: Extract<Section, { kind: "box" }> = { kind: "box", lower: [1, 2, 3], upper: [4, 6, 8] };
  const told = (frame: PlantFrame) =>
    facesOf(frame, box).map(({ letter, low, high }) => [letter, low.at, high.at, low.name, high.name]);
  const frame: PlantFrame = { origin: [100, 200, 300], north_deg: 0 };
  assert.deepEqual(told(frame), [
    ["E", 101, 104, "lower E", "upper E"],
    ["N", 192, 197, "lower N", "upper N"],
    ["U", 302, 306, "lower U", "upper U"],
  ]);
  assert.deepEqual(told({ ...frame, north_deg: 90 }), [
    ["E", 103, 108, "lower E", "upper E"],
    ["N", 201, 204, "lower N", "upper N"],
    ["U", 302, 306, "lower U", "upper U"],
  ]);
  // At an angle, the sides across the ground are those of the scene.
  assert.deepEqual(told({ ...frame, north_deg: 10 }), [
    ["U", 302, 306, "lower U", "upper U"],
    ["x", 1, 4, "lower x", "upper x"],
    ["z", 3, 8, "lower z", "upper z"],
  ]);
  // The northern side of the box to N 198, and a shift of each side by a metre leads to where it says.
  const north = facesOf(frame, box)[1]?.high;
  assert.ok(north);
  assert.deepEqual(resized(box, north.side, north.axis, north.atOf(198)), { ...box, lower: [1, 2, 2] });
  for (const north_deg of [0, 90, 180, -90, 45]) {
    for (const { low, high } of facesOf({ ...frame, north_deg }, box)) {
      for (const face of [low, high]) {
        const by = face === low ? -1 : 1;
        const moved = resized(box, face.side, face.axis, face.atOf(face.at + by));
        assert.ok(moved.kind === "box");
        const at = (of: typeof box) =>
          facesOf({ ...frame, north_deg }, of).map((one) => [one.low.at, one.high.at]);
        const [before, after] = [at(box).flat(), at(moved).flat()];
        const changed = before.flatMap((value, index) =>
          after[index] === value ? [] : (after[index] ?? 0) - value,
        );
        assert.deepEqual(changed, [by], `${face.name} at ${north_deg}`);
      }
    }
  }
});

test("a plane is told by its coordinate, or by a point of it", () => {
  const frame: PlantFrame = { origin: [100, 200, 300], north_deg: 0 };
  const plane = (direction: Point): Section => ({ kind: "plane", point: [1, 2, 3], direction });
  assert.equal(planeText(frame, plane([0, 0, -4]), "m"), "N 197.000 m");
  assert.equal(planeText(frame, plane([0, 1, 0]), "mm"), "U 302000 mm");
  assert.equal(planeText(frame, plane([1, 1, 0]), "m"), "E 101.000 m, N 197.000 m, U 302.000 m");
  assert.equal(planeText({ ...frame, north_deg: 3 }, plane([0, 1, 0]), "m"), "U 302.000 m");
  assert.match(planeText({ ...frame, north_deg: 3 }, plane([1, 0, 0]), "m"), /^E .*, N .*, U 302.000 m$/);
});
