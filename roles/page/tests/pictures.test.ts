/** The sizes of saved pictures, their tiles and their captions. */

import assert from "node:assert/strict";
import { test } from "node:test";
import { Projection } from "../src/draw/projection.ts";
import { cutOut, fitting, offsetOf, type Region, tilesOf, whole } from "../src/draw/region.ts";
import { View } from "../src/draw/view.ts";
import { Gaze } from "../src/navigate/gaze.ts";
import { axesOf } from "../src/navigate/orbit.ts";
import { wayInPicture } from "../src/space/plantFrame.ts";
import type { Point } from "../src/space/point.ts";
import { type Dimension, dimensionOf } from "../src/tools/dimensions.ts";
import { lengthText, UNITS } from "../src/tools/lengths.ts";
import { arrowOf, barOf, type Caption, textsOf } from "../src/tools/pictures/caption.ts";
import { dimensionLine } from "../src/tools/pictures/dimensionLines.ts";
import { culled, largest, layoutOf, showingAll, stripOf, textSizeOf } from "../src/tools/pictures/layout.ts";
import { PAPERS, paperLayout } from "../src/tools/pictures/print.ts";
import { roundLength } from "../src/tools/pictures/scaleBar.ts";
import { randomOf } from "../wire/tests/support.ts";
import { cameraAt, drawableAt } from "./drawScene.ts";

const MOST = { width: 4096, height: 4096 };
const SCREEN = { width: 1400, height: 900 };

test("tiles cover each pixel once, and the hatching of all of them is one", () => {
  for (const of of [
    { width: 1, height: 1 },
    { width: 1008, height: 1008 },
    { width: 1009, height: 500 },
    { width: 3840, height: 2160 },
  ]) {
    const met = new Uint8Array(of.width * of.height);
    for (const { left, bottom, width, height, drawn } of tilesOf(of)) {
      for (let row = bottom; row < bottom + height; row += 1) {
        for (let column = left; column < left + width; column += 1) {
          met[row * of.width + column] = (met[row * of.width + column] ?? 0) + 1;
        }
      }
      assert.deepEqual(drawn.of, of);
      // The pattern of the shader goes by the sum of both coordinates.
      assert.equal(Math.abs((drawn.left + drawn.bottom) % 9), 0);
      // Ambient occlusion looks at this many pixels around, and lines at two. Beyond the picture is nothing.
      const apron = 0.08 * of.height + 2;
      assert.ok(drawn.left === 0 || drawn.left <= left - apron);
      assert.ok(drawn.bottom === 0 || drawn.bottom <= bottom - apron);
      const [right, top] = [drawn.left + drawn.width, drawn.bottom + drawn.height];
      assert.ok(
        drawn.left >= 0 && (right === of.width || (right >= left + width + apron && right < of.width)),
      );
      assert.ok(
        drawn.bottom >= 0 && (top === of.height || (top >= bottom + height + apron && top < of.height)),
      );
    }
    assert.ok(met.every((times) => times === 1));
  }
});

test("a tile's pixels are cut out of what was drawn for it, with the upper row first", () => {
  const drawn: Region = { of: { width: 9, height: 9 }, left: -1, bottom: 2, width: 4, height: 5 };
  const pixels = new Uint8Array(4 * 4 * 5);
  for (let at = 0; at < 20; at += 1) {
    pixels[4 * at] = at;
  }
  const cut = cutOut({ left: 0, bottom: 3, width: 2, height: 3, drawn }, pixels);
  const first = Array.from({ length: 6 }, (_, pixel) => cut[4 * pixel]);
  assert.deepEqual(first, [13, 14, 9, 10, 5, 6]);
});

test("a region shows what the whole picture has there", () => {
  const random = randomOf(7);
  for (let round = 0; round < 200; round += 1) {
    const of = { width: 1 + random(5000), height: 1 + random(5000) };
    const [left, bottom] = [random(of.width) - 9, random(of.height) - 9];
    const region = { of, left, bottom, width: 1 + random(2000), height: 1 + random(2000) };
    const by = [random(100) / 100 - 0.5, random(100) / 100 - 0.5] as const;
    const [x, y] = [random(10_000) / 5000 - 1, random(10_000) / 5000 - 1];
    const { scale, shift } = fitting(region, by);
    const pixel = (at: number, size: number) => ((at + 1) / 2) * size;
    const there = [
      pixel(x * scale[0] + shift[0], region.width),
      pixel(y * scale[1] + shift[1], region.height),
    ];
    const expected = [pixel(x, of.width) + by[0] - left, pixel(y, of.height) + by[1] - bottom];
    for (const axis of [0, 1]) {
      assert.ok(Math.abs((there[axis] ?? 0) - (expected[axis] ?? 0)) < 1e-6, `${there} ${expected}`);
    }
  }
  assert.deepEqual(offsetOf(whole(SCREEN)), [0, 0]);
  assert.deepEqual(fitting(whole(SCREEN), [0, 0]), { scale: [1, 1], shift: [0, 0] });
});

test("what lies beside a region is not drawn for it", () => {
  const view = new View();
  const bounds = Float64Array.from([0, 0, 0, 0.1, 0.1, 0.1]);
  const of = { width: 200, height: 100 };
  // A box in the right half, above the middle.
  view.set(cameraAt([0, 0, 0]), of.width, of.height);
  view.place(drawableAt(0, [2, 1, -4]));
  assert.ok(view.sees(bounds));
  for (const [left, bottom, isSeen] of [
    [100, 50, true],
    [0, 50, false],
    [100, 0, false],
    [0, 0, false],
  ] as const) {
    view.set(cameraAt([0, 0, 0]), of.width, of.height);
    view.narrow({ of, left, bottom, width: 100, height: 50 });
    view.place(drawableAt(0, [2, 1, -4]));
    assert.equal(view.sees(bounds), isSeen, `${left} ${bottom}`);
  }
});

test("a file has the chosen size, or the screen's proportions", () => {
  const size = { width: 3840, height: 2160 };
  const chosen = layoutOf({ size, keepsShape: false, isCaptioned: true }, SCREEN, MOST);
  assert.deepEqual(chosen, { file: size, picture: { width: 3840, height: 2064 }, strip: 96 });
  const plain = layoutOf({ size, keepsShape: false, isCaptioned: false }, SCREEN, MOST);
  assert.deepEqual(plain, { file: size, picture: size, strip: 0 });
  const kept = layoutOf({ size, keepsShape: true, isCaptioned: true }, SCREEN, MOST);
  assert.deepEqual(kept.picture, { width: 3840, height: 2469 });
  assert.deepEqual(kept.file, { width: 3840, height: 2469 + 96 });
});

test("a picture that cannot be culled for is refused, with the limit", () => {
  const limit = largest(MOST);
  assert.deepEqual(culled(limit), MOST);
  const layout = (width: number, height: number) =>
    layoutOf({ size: { width, height }, keepsShape: false, isCaptioned: false }, SCREEN, MOST);
  assert.deepEqual(layout(limit.width, limit.height).file, limit);
  for (const [width, height] of [
    [limit.width + 1, 100],
    [100, limit.height + 1],
    [0, 100],
    [-100, 100],
    [100.5, 100],
    [Number.NaN, 100],
    [100, Number.POSITIVE_INFINITY],
    [1e300, 1e300],
  ] as const) {
    assert.throws(() => layout(width, height), /culls for 64 to 4088 pixels wide/, `${width} x ${height}`);
  }
});

test("a picture of other proportions shows all that the screen shows", () => {
  const tan = 0.5;
  const across = (tan * SCREEN.width) / SCREEN.height;
  for (const picture of [
    { width: 3840, height: 2160 },
    { width: 1000, height: 3000 },
    { width: 1400, height: 900 },
  ]) {
    const shown = showingAll(tan, SCREEN, picture);
    assert.ok(shown >= tan && (shown * picture.width) / picture.height >= across * (1 - 1e-12));
    assert.ok(shown === tan || (shown * picture.width) / picture.height <= across * (1 + 1e-12));
  }
});

test("a sheet of paper is filled, as finely as the service can", () => {
  for (const paper of PAPERS) {
    const { file, picture } = paperLayout(paper, true, MOST);
    const ratio = paper === "A4" ? 277 / 190 : 400 / 277;
    assert.ok(Math.abs(file.width / file.height - ratio) < 1e-3, paper);
    assert.ok(picture.width <= 4088 && picture.height <= 4088);
    assert.ok(file.width > 3200, `${paper} has ${file.width} pixels`);
  }
  assert.equal(paperLayout("A3", true, { width: 800, height: 700 }).file.width, 792);
});

test("a scale bar has a round length", () => {
  for (const [most, unit, text] of [
    [7.3, "m", "5.000 m"],
    [5, "m", "5.000 m"],
    [4.999, "mm", "2000 mm"],
    [0.0199, "m", "0.010 m"],
    [123, "m", "100.000 m"],
    [10, "ft-in", `20' 0.00"`],
    [0.31, "ft-in", `1' 0.00"`],
    [0.3, "ft-in", `6.00"`],
    [0.09, "ft-in", `3.00"`],
    [0.026, "ft-in", `1.00"`],
    [0.02, "ft-in", `0.50"`],
  ] as const) {
    assert.equal(lengthText(roundLength(most, unit), unit), text, `${most} ${unit}`);
  }
  const random = randomOf(3);
  for (let round = 0; round < 300; round += 1) {
    const most = 10 ** (random(120) / 10 - 6) * (1 + random(1000) / 1000);
    for (const unit of UNITS) {
      const length = roundLength(most, unit);
      assert.ok(length <= most * (1 + 1e-9) && length > 0.39 * most, `${length} of ${most} ${unit}`);
    }
  }
});

test("a caption names the model, the subject and the day, and scales at a distance", () => {
  const caption: Caption = {
    title: "plant",
    text: "",
    subject: "20-CE50",
    date: new Date(2031, 0, 5, 23, 59),
    focus: 20,
    north: [0, 0],
    isParallel: false,
  };
  assert.deepEqual(textsOf(caption), ["plant", "20-CE50", "2031-01-05"]);
  assert.deepEqual(textsOf({ ...caption, subject: "" }), ["plant", "2031-01-05"]);
  const own = { ...caption, text: " For the review " };
  assert.deepEqual(textsOf(own), ["plant", "For the review", "20-CE50", "2031-01-05"]);
  // A pixel is 1 cm there: the longest bar of 180 pixels is one of a metre.
  const strip = { top: 0, width: 1000, height: 30, metresEach: 0.01 / 20 };
  const bar = barOf(caption, strip);
  assert.ok(Math.abs((bar?.pixels ?? 0) - 100) < 1e-9);
  assert.equal(bar?.text, "1.000 m, 20.000 m away");
  for (const focus of [undefined, 0, -3, Number.NaN, Number.POSITIVE_INFINITY]) {
    assert.equal(barOf({ ...caption, focus }, strip), undefined);
  }
  // The scale of a parallel picture needs no distance. On paper a pixel is a tenth of a millimetre.
  const flat = { focus: 20, isParallel: true };
  assert.deepEqual(barOf(flat, strip), { pixels: bar?.pixels, text: "1.000 m, parallel" });
  const printed = barOf(flat, { ...strip, printedEach: 1.0004e-4 });
  assert.equal(printed?.text, "1.000 m, parallel, 1 : 100 on paper");
});

test("the arrow of a plan points north, is shorter at a slope, and absent if one looks along it", () => {
  const strip = { top: 900, width: 1000, height: 100, metresEach: 1 };
  const north = (forward: Point, north_deg: number) => {
    return wayInPicture({ origin: [5, 6, 7], north_deg }, axesOf(new Gaze(forward)), [0, 1, 0]);
  };
  const tipOf = (forward: Point, north_deg: number) => {
    const arrow = arrowOf({ north: north(forward, north_deg) }, strip);
    const [tip] = arrow?.head ?? [];
    return tip && [tip.x, tip.y].map(Math.round);
  };
  // Its middle is at 940, 950, and it is 84 pixels long. The trace keeps -z at the top.
  const down: Point = [0, -1, -1e-9];
  assert.deepEqual(tipOf(down, 0), [940, 908]);
  assert.deepEqual(tipOf(down, 90), [982, 950]);
  assert.deepEqual(tipOf(down, 180), [940, 992]);
  // From 30 degrees above, half of it is left.
  assert.deepEqual(tipOf([0, -0.5, -Math.sqrt(0.75)], 0), [940, 929]);
  assert.equal(tipOf([0, 0, -1], 0), undefined);
  assert.deepEqual(tipOf([0, 0, -1], 90), [982, 950]);
  const arrow = arrowOf({ north: north(down, 0) }, strip);
  assert.deepEqual(arrow?.foot.y && Math.round(arrow.foot.y), 992);
});

/** A metre is 100 pixels at 10 m. */
const PROJECTION = new Projection(
  { eye: [0, 0, 0], orientation: [0, 0, 0, 1], tanHalfFov: 0.5, near: 0.1 },
  1000,
  1000,
);

function dimension(from: Point, to: Point): Dimension | undefined {
  return dimensionOf({ from: { point: from, error: 0 }, to: { point: to, error: 0 } }, PROJECTION, "m");
}

test("a dimension is clipped to the picture, and is told from one behind the eye", () => {
  const whole = dimension([-1, 0, -10], [2, 1, -10]);
  assert.deepEqual(whole, {
    from: { x: 400, y: 500, isCut: false },
    to: { x: 700, y: 400, isCut: false },
    isInFront: true,
    label: "3.162 m",
  });
  const cut = dimension([0, 0, -10], [10, 5, -10]);
  assert.deepEqual(cut?.to, { x: 1000, y: 250, isCut: true });
  assert.deepEqual([cut?.from.isCut, cut?.isInFront, cut?.label], [false, true, "11.180 m"]);
  const behind = dimension([0, 0, -10], [0, 1, 5]);
  assert.deepEqual([behind?.isInFront, behind?.to.isCut], [false, true]);
  assert.ok(Math.abs(behind?.to.y ?? 1) < 1e-9);
  assert.equal(dimension([6, 0, -10], [9, 5, -10]), undefined);
  // Across a corner of the picture, without touching it.
  assert.equal(dimension([4, 9, -10], [9, 4, -10]), undefined);
  assert.equal(dimension([0, 0, 5], [0, 1, 5]), undefined);
});

test("a dimension line has heads at its ends, and its plate beside it within the picture", () => {
  const laid = (from: Point, to: Point, size = 20) => {
    const one = dimension(from, to);
    assert.ok(one);
    return dimensionLine(one, size, 80, PROJECTION.size);
  };
  const level = laid([-1, 0, -10], [2, 0, -10]);
  assert.equal(level.strokes.length, 1);
  assert.deepEqual(level.heads[0], [
    { x: 400, y: 500, isCut: false },
    { x: 416, y: 505 },
    { x: 416, y: 495 },
  ]);
  assert.deepEqual(level.heads[1]?.[1].x, 684);
  // Above the line, around the text.
  assert.deepEqual(level.plate, { left: 504, top: 462, width: 92, height: 32 });
  const upright = laid([0, -1, -10], [0, 1, -10]);
  assert.deepEqual(upright.plate, { left: 506, top: 484, width: 92, height: 32 });
  // A short line has its heads outside, on extensions of it.
  const short = laid([0, 0, -10], [0.2, 0, -10]);
  assert.deepEqual(
    short.heads.map(([tip, base]) => [tip.x, base.x]),
    [
      [500, 484],
      [520, 536],
    ],
  );
  assert.deepEqual(
    short.strokes.slice(1).map(([from, to]) => [from.x, to.x]),
    [
      [500, 468],
      [520, 552],
    ],
  );
  const end = laid([0, 0, -10], [0, 0, -20]);
  assert.deepEqual(
    end.heads.map(([tip, base]) => [tip.x, base.x]),
    [
      [500, 484],
      [500, 516],
    ],
  );
  // No head where the picture ends, and no plate beyond it.
  const cut = laid([0, 4.9, -10], [10, 4.9, -10]);
  assert.deepEqual([cut.heads.length, cut.plate.top], [1, 0]);
  // A large picture has large heads and texts.
  assert.deepEqual(
    [3840, 1920, 500].map((width) => textSizeOf(stripOf(width))),
    [40, 20, 12],
  );
});
