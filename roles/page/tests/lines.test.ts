/** Lines and dark corners of a picture at rest: their places, and places without them. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { MotionLook } from "../src/draw/motionLook.ts";
import { STEPS, stepOf } from "../src/draw/still.ts";
import { drawing } from "./drawBrowser.ts";

const drawn = drawing();

/** Runs `draw` in the page, which returns darkness by name: see `darkness`. */
const lines = (name: string, draw: () => Darkness, check: (found: Darkness) => void) =>
  drawn(name, undefined, draw, check);

/** By name: the share of pixels of a part of the picture that are darker than nine tenths of its median. */
type Darkness = Record<string, number>;

test("lines come little by little, and in the mean they are as strong as they are", () => {
  const strengths = Array.from({ length: STEPS }, (_, step) => stepOf(step, false).strength);
  assert.ok(strengths.every((strength, step) => step === 0 || strength > (strengths[step - 1] ?? 0)));
  assert.ok((strengths[0] ?? 1) < 0.2);
  assert.equal(strengths.reduce((sum, strength) => sum + strength) / STEPS, 1);
  assert.ok(strengths.every((_, step) => stepOf(step, true).strength === 1));
});

test("a moving eye has lines only where they cost no time, and a failed trial is seldom repeated", () => {
  const look = new MotionLook(true);
  /** Moves for so many frames, which take `without`, or `lined` with lines. Returns how many had lines. */
  const move = (frames: number, without: number, lined: number) => {
    let had = 0;
    for (let frame = 0; frame < frames; frame += 1) {
      had += look.isOn ? 1 : 0;
      look.add(look.isOn ? lined : without);
    }
    return had;
  };
  assert.equal(move(15, 16.7, 16.7), 0);
  assert.equal(move(1000, 16.7, 17.5), 1000);
  // Things become heavier.
  assert.ok(move(60, 16.7, 33.4) <= 30);
  const trials = move(10_000, 16.7, 33.4) / 15;
  assert.ok(trials >= 5 && trials <= 8, `${trials} trials`);
  // Pauses between movements are no intervals.
  const other = new MotionLook(true);
  for (let times = 0; times < 100; times += 1) {
    other.add(16.7);
    other.add(500);
    other.rest();
  }
  assert.equal(other.isOn, false);
  // Without a graphics card.
  const none = new MotionLook(false);
  for (let frame = 0; frame < 1000; frame += 1) {
    none.add(16.7);
  }
  assert.equal(none.isOn, false);
});

drawn(
  "the lines of a moving eye are there at once, and stay once it rests",
  undefined,
  () => {
    const { cameraAt, drawableAt, plate, Stage } = window.draw;
    const found: Record<string, number> = {};
    for (const samples of [1, 4]) {
      const stage = new Stage(64, 64, { samples });
      stage.set(plate(1, 1, [200, 200, 200]));
      const drawables = [drawableAt(0, [0, 0, -4]), drawableAt(1, [0.2, 0, -6])];
      const darkest = () => {
        const pixels = new Uint8Array(4 * 64 * 64);
        stage.gl.readPixels(0, 0, 64, 64, stage.gl.RGBA, stage.gl.UNSIGNED_BYTE, pixels);
        return Math.min(...pixels.filter((_, at) => at % 4 === 0));
      };
      for (const isOn of [false, true]) {
        stage.renderer.motion.isOn = isOn;
        stage.renderer.draw(cameraAt([0, 0, 0]), drawables);
        found[`${samples} ${isOn} moving`] = darkest();
        while (stage.renderer.refine()) {
          found[`${samples} ${isOn} resting`] ??= darkest();
        }
      }
      stage.end();
    }
    return found;
  },
  (found) => {
    for (const samples of [1, 4]) {
      const [plain, lined] = [found[`${samples} false moving`] ?? 0, found[`${samples} true moving`] ?? 255];
      assert.ok(lined < 0.7 * plain, JSON.stringify(found));
      assert.ok((found[`${samples} false resting`] ?? 0) > 0.8 * plain, JSON.stringify(found));
      assert.ok((found[`${samples} true resting`] ?? 255) < 0.7 * plain, JSON.stringify(found));
    }
  },
);

lines(
  "nothing flat has lines in it, however it is looked along and of whatever it is put together",
  () => {
    const { cameraAt, darkness, drawableAt, plate, Stage } = window.draw;
    const found: Record<string, number> = {};
    for (const degrees of [89, 80, 60, 30, 5, 2, 1]) {
      // A floor at this angle to the view, of plates tenths of a pixel off one plane.
      const angle = ((90 - degrees) * Math.PI) / 180;
      const [sin, cos] = [Math.sin(angle), Math.cos(angle)];
      const linear = [1, 0, 0, 0, cos, -sin, 0, sin, cos];
      const stage = new Stage(128, 128, { samples: 1 });
      stage.set(plate(8, 8));
      const drawables = Array.from({ length: 81 }, (_, id) => {
        const [right, along] = [8 * ((id % 9) - 4), 8 * (Math.floor(id / 9) - 4)];
        const off = 2e-4 * ((id * 7) % 5);
        return drawableAt(id, [right, cos * along + sin * off, -40 - sin * along + cos * off], {
          geometry: 0,
          linear,
        });
      });
      found[degrees] = darkness(stage, cameraAt([0, 0, 0]), drawables, [40, 66, 48, 5]);
      stage.end();
    }
    return found;
  },
  (found) => {
    for (const [degrees, dark] of Object.entries(found)) {
      assert.equal(dark, 0, `at ${degrees} degrees: ${JSON.stringify(found)}`);
    }
  },
);

lines(
  "what stands in for something round has no lines along it, but its outline has",
  () => {
    const { cameraAt, darkness, drawableAt, FRONT_SIDE, pipe, Stage } = window.draw;
    const found: Record<string, number> = {};
    for (const sides of [12, 16, 24]) {
      const stage = new Stage(128, 128, { samples: 1 });
      stage.set(pipe(1, 12, sides, 3, [200, 200, 200]));
      const drawables = [drawableAt(0, [0, 0, -6], { sides: FRONT_SIDE })];
      // A column of pixels: shades change across the pipe, and not along it.
      for (const column of [45, 52, 60, 64, 70, 77, 84]) {
        const key = `${sides} sides, column ${column}`;
        found[key] = darkness(stage, cameraAt([0, 1, 0]), drawables, [column, 20, 1, 88]);
      }
      const edge = Math.round(64 + (64 / 0.5) * (1 / Math.sqrt(35)));
      found[`outline ${sides}`] = darkness(stage, cameraAt([0, 0, 0]), drawables, [edge - 5, 60, 6, 8]);
      stage.end();
    }
    return found;
  },
  (found) => {
    for (const [where, dark] of Object.entries(found)) {
      const isOutline = where.startsWith("outline");
      assert.ok(isOutline ? dark > 0.1 : dark === 0, `${where}: ${JSON.stringify(found)}`);
    }
  },
);

lines(
  "edges, steps and what is before the sky have lines",
  () => {
    const { box, cameraAt, darkness, drawableAt, plate, Stage } = window.draw;
    const stage = new Stage(128, 128, { samples: 1 });
    stage.set(box([2, 2, 2]), plate(20, 20));
    const half = Math.SQRT1_2;
    // A box with an edge towards the eye, and a plate half a metre before another one.
    const turned = drawableAt(0, [0, 0, -8], { linear: [half, 0, -half, 0, 1, 0, half, 0, half] });
    const low = drawableAt(1, [0, 0, -10.5], { geometry: 1 });
    const high = drawableAt(2, [10, 0, -10], { geometry: 1 });
    const camera = cameraAt([0, 0, 0]);
    const found = {
      edge: darkness(stage, camera, [turned], [60, 60, 9, 9]),
      sky: darkness(stage, camera, [turned], [60, 40, 9, 6]),
      step: darkness(stage, camera, [low, high], [60, 60, 9, 9]),
      floor: darkness(stage, camera, [low], [20, 20, 80, 80]),
    };
    stage.end();
    return found;
  },
  ({ edge = 0, step = 0, floor = 1 }) => {
    assert.ok(edge > 0.1, `${edge}`);
    assert.ok(step > 0.1, `${step}`);
    assert.equal(floor, 0);
  },
);

lines(
  "what is see-through has lines, and so has what it is before",
  () => {
    const { box, cameraAt, darkness, drawableAt, ObjectSet, plate, Stage } = window.draw;
    const stage = new Stage(128, 128, { samples: 1 });
    stage.set(plate(2, 2, [230, 230, 230]), box([1, 1, 1], [230, 230, 230]), plate(30, 30, [230, 230, 230]));
    const glass = drawableAt(0, [0, 0, -4]);
    const behind = drawableAt(1, [0, 0, -8]);
    const wall = drawableAt(2, [0, 0, -12]);
    const look = { sections: [], highlighted: ObjectSet.EMPTY, seeThrough: ObjectSet.of([glass.object]) };
    const camera = cameraAt([0, 0, 0]);
    // The glass ends 32 pixels from the middle, and the box 8 to 9.
    const found = {
      glass: darkness(stage, camera, [glass, behind, wall], [90, 60, 12, 8], look),
      behind: darkness(stage, camera, [glass, behind, wall], [68, 60, 10, 8], look),
      between: darkness(stage, camera, [glass, behind, wall], [78, 60, 10, 8], look),
    };
    stage.end();
    return found;
  },
  ({ glass = 0, behind = 0, between = 1 }) => {
    assert.ok(glass > 0.05, `${glass}`);
    assert.ok(behind > 0.05, `${behind}`);
    assert.equal(between, 0);
  },
);

lines(
  "a wall is dark beside a thing that stands at it, and not behind one that is far before it",
  () => {
    const { box, cameraAt, darkness, drawableAt, plate, Stage } = window.draw;
    const stage = new Stage(128, 128, { samples: 1 });
    stage.set(box([2, 2, 0.5]), plate(20, 20));
    const wall = drawableAt(1, [0, 0, -10], { geometry: 1 });
    const camera = cameraAt([0, 0, 0]);
    // Strips of the wall from two pixels beside the box on.
    const found = {
      near: darkness(stage, camera, [drawableAt(0, [0, 0, -9.75]), wall], [80, 60, 40, 8]),
      far: darkness(stage, camera, [drawableAt(0, [0, 0, -6]), wall], [89, 60, 35, 8]),
    };
    stage.end();
    return found;
  },
  ({ near = 0, far = 1 }) => {
    assert.ok(near > 0.01, `${near}`);
    assert.equal(far, 0);
  },
);
