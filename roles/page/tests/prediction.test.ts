import assert from "node:assert/strict";
import { test } from "node:test";
import { Path } from "../src/drive/path.ts";
import { Prediction } from "../src/viewer/prediction.ts";

test("an eye that goes on is foreseen where it will be", () => {
  const prediction = new Prediction();
  assert.equal(prediction.after(50), undefined);
  for (let at = 0; at <= 300; at += 10) {
    prediction.add(at, { eye: [at / 100, 1, -at / 50], heading: at / 1000, pitch: 0.1 });
  }
  const foreseen = prediction.after(100);
  assert.ok(foreseen);
  const { eye, heading, pitch } = foreseen;
  for (const [found, expected] of [
    [eye[0], 4],
    [eye[1], 1],
    [eye[2], -8],
    [heading, 0.4],
    [pitch, 0.1],
  ] as const) {
    assert.ok(Math.abs(found - expected) < 1e-9, `${found} for ${expected}`);
  }
  assert.deepEqual(prediction.after(10_000), prediction.after(250), "nobody is foreseen for long");
});

test("an eye that rests or has jumped stays where it is", () => {
  const prediction = new Prediction();
  const pose = (x: number) => ({ eye: [x, 0, 0] as const, heading: 0, pitch: 0 });
  prediction.add(0, pose(0));
  prediction.add(50, pose(5));
  for (let at = 60; at <= 200; at += 10) {
    prediction.add(at, pose(5));
  }
  assert.deepEqual(prediction.after(100)?.eye, [5, 0, 0]);
  prediction.forget();
  prediction.add(210, pose(900));
  assert.deepEqual(prediction.after(100)?.eye, [900, 0, 0]);
});

test("a heading goes the short way round", () => {
  const prediction = new Prediction();
  prediction.add(0, { eye: [0, 0, 0], heading: 3.1, pitch: 0 });
  prediction.add(100, { eye: [0, 0, 0], heading: -3.1, pitch: 0 });
  const heading = prediction.after(100)?.heading ?? 0;
  assert.ok(Math.abs(heading - (-3.1 + (2 * Math.PI - 6.2))) < 1e-9, String(heading));
});

test("a walk goes on between its poses, and jumps where it is written", () => {
  const along = [0, 1, 2, 3, 100, 101].map((x) => ({
    eye: [x, 0, 0] as const,
    forward: [0, 0, -1] as const,
  }));
  const path = new Path({ frames: along });
  assert.deepEqual(path.at(0.5 / 30, 0)?.eye, [0.5, 0, 0]);
  assert.deepEqual(path.at(3.5 / 30, 3.2 / 30)?.eye, [3, 0, 0], "nobody is on the way of a jump");
  const jumped = path.at(4.5 / 30, 3.5 / 30);
  assert.deepEqual([jumped?.eye, jumped?.isJump], [[100.5, 0, 0], true]);
  assert.equal(path.at(4.8 / 30, 4.5 / 30)?.isJump, false);
  assert.equal(path.at(6 / 30, 5 / 30), undefined, "it has ended");
});
