import assert from "node:assert/strict";
import { test } from "node:test";
import { type Place, Projection } from "../src/draw/projection.ts";
import { directionOf } from "../src/navigate/gaze.ts";
import type { Navigator } from "../src/navigate/navigator.ts";
import { HEIGHTS, isParallel, orthogonalOf, PARALLEL_DEG, poseOf } from "../src/navigate/parallel.ts";
import { SIDES } from "../src/navigate/standardViews.ts";
import { ObjectSet } from "../src/proto/objectSet.ts";
import { beyond, distance, type Point } from "../src/space/point.ts";
import { decodeViewpoint, encodeViewpoint } from "../src/tools/viewpoint.ts";
import { Prediction } from "../src/viewer/prediction.ts";
import { navigatorAtOrigin } from "./atOrigin.ts";

const [WIDTH, HEIGHT] = [800, 600];

function through({ eye, orientation, tanHalfFov }: Navigator): Projection {
  return new Projection({ eye, orientation, tanHalfFov, near: 1e-9 }, WIDTH, HEIGHT);
}

function placeOf(walker: Navigator, point: Point): Place {
  const place = through(walker).place(point);
  assert.ok(place, `${point} is in the picture`);
  return place;
}

/** The pixels between the places of two points. */
function span(walker: Navigator, a: Point, b: Point): number {
  const [from, to] = [placeOf(walker, a), placeOf(walker, b)];
  return Math.hypot(to.x - from.x, to.y - from.y);
}

function wheel(canvas: EventTarget, x: number, y: number, deltaY: number): void {
  canvas.dispatchEvent(Object.assign(new Event("wheel"), { offsetX: x, offsetY: y, deltaY }));
}

test("what is in the middle keeps its size and place, and all is as before after going back", () => {
  const { walker } = navigatorAtOrigin();
  walker.goTo([3, 2, 7], [-0.2, -0.1, -1]);
  const seen = through(walker).point({ x: WIDTH / 2, y: HEIGHT / 2, depth: 6 });
  walker.pointAt = () => seen;
  const beside: Point = [seen[0], seen[1] + 0.5, seen[2]];
  const before = { place: placeOf(walker, seen), size: span(walker, seen, beside), eye: walker.eye };
  walker.toggleProjection();
  assert.deepEqual([walker.projection.peek(), walker.mode.peek()], ["parallel", "orbit"]);
  const after = placeOf(walker, seen);
  assert.ok(Math.hypot(after.x - before.place.x, after.y - before.place.y) < 1e-6, JSON.stringify(after));
  // The bar leans a little, so half of it is nearer.
  assert.ok(Math.abs(span(walker, seen, beside) / before.size - 1) < 0.01);
  const height = 2 * 6 * Math.tan(Math.PI / 6);
  assert.ok(Math.abs(after.depth / (HEIGHTS * height) - 1) < 1e-9, "a thousand heights away");
  walker.toggleProjection();
  assert.deepEqual(
    [walker.projection.peek(), walker.vfovDeg, walker.mode.peek()],
    ["perspective", 60, "orbit"],
  );
  assert.ok(distance(walker.eye, before.eye) < 1e-9, `${walker.eye}`);
  // The way back leads to the parallel view, and then to the mode before it.
  walker.goBack();
  walker.goBack();
  assert.deepEqual(
    [walker.eye, walker.projection.peek(), walker.mode.peek()],
    [before.eye, "perspective", "fly"],
  );
});

test("what is a picture height farther away is a thousandth smaller, and no more", () => {
  const { walker } = navigatorAtOrigin();
  walker.toggleProjection();
  walker.frameFrom({ min: [-5, -5, -5], max: [5, 5, 5] }, [0, 0, -1]);
  const height = through(walker).heightAt(placeOf(walker, [0, 0, 0]).depth);
  assert.ok(height > 11.5 && height < 11.8, `86 % of it are filled: ${height}`);
  const width = (z: number) => span(walker, [-1, 0, z], [1, 0, z]);
  const smaller = 1 - width(-height) / width(0);
  assert.ok(smaller > 0.0009 && smaller < 0.0011, `${smaller}`);
  const pixels = Math.abs(width(-5) - width(5));
  assert.ok(pixels < 0.1, `a near box and a far one differ by ${pixels} pixels`);
});

test("the wheel changes the size around the pointer, with or without something there, within limits", () => {
  for (const isThere of [true, false]) {
    const { walker, canvas } = navigatorAtOrigin();
    walker.toggleProjection();
    walker.frameFrom({ min: [-1, -1, -1], max: [1, 1, 1] }, [0, 0, -1]);
    const point = through(walker).point({ x: 650, y: 100, depth: placeOf(walker, [0, 0, 0]).depth });
    walker.pointAt = () => (isThere ? point : undefined);
    const width = () => span(walker, [0, 0, 0], [0.001, 0, 0]);
    const before = width();
    wheel(canvas, 650, 100, -1);
    assert.ok(Math.abs((0.85 * width()) / before - 1) < 1e-6, `${width()} after ${before}`);
    const { x, y } = placeOf(walker, point);
    assert.ok(Math.hypot(x - 650, y - 100) < 1e-6, `${x} ${y}`);
    for (let step = 0; step < 300; step += 1) {
      wheel(canvas, 650, 100, -1);
    }
    const { x: near, y: there, depth } = placeOf(walker, point);
    assert.ok(Math.hypot(near - 650, there - 100) < 1e-3, "it stays there");
    const nearest = through(walker).heightAt(depth);
    assert.ok(nearest > 0.009 && nearest < 0.011, `no picture is less high than a centimetre: ${nearest}`);
    for (let step = 0; step < 600; step += 1) {
      wheel(canvas, 400, 300, 1);
    }
    const farthest = through(walker).heightAt(placeOf(walker, [0, 0, 0]).depth);
    assert.ok(farthest > 100 && farthest < 130, `30 diagonals of the model: ${farthest}`);
  }
});

test("keys move the picture by half of its height a second, and plus makes its middle larger", () => {
  const { walker } = navigatorAtOrigin();
  walker.toggleProjection();
  walker.frameFrom({ min: [-1, -1, -1], max: [1, 1, 1] }, [1, 0, 0]);
  const before = placeOf(walker, [0, 0, 0]);
  for (const [code, x, y] of [
    ["KeyD", -1, 0],
    ["ArrowRight", -1, 0],
    ["KeyA", 1, 0],
    ["ArrowLeft", 1, 0],
    ["KeyW", 0, 1],
    ["ArrowUp", 0, 1],
    ["KeyE", 0, 1],
    ["KeyQ", 0, -1],
    ["KeyS", 0, -1],
  ] as const) {
    const { eye, forward } = walker;
    walker.press(code, true);
    walker.step(0.1);
    walker.press(code, false);
    const place = placeOf(walker, [0, 0, 0]);
    assert.ok(Math.abs(place.x - before.x - 0.05 * HEIGHT * x) < 1e-3, `${code}: ${place.x}`);
    assert.ok(Math.abs(place.y - before.y - 0.05 * HEIGHT * y) < 1e-3, `${code}: ${place.y}`);
    assert.deepEqual(walker.forward, forward);
    walker.goTo(eye, forward);
  }
  const size = () => span(walker, [0, 0, 0], [0, 0.001, 0]);
  const small = size();
  walker.widen(-5);
  assert.ok(size() > 1.1 * small, `${size()} after ${small}`);
  const { x, y } = placeOf(walker, [0, 0, 0]);
  assert.ok(Math.hypot(x - WIDTH / 2, y - HEIGHT / 2) < 1e-6, `${x} ${y}`);
});

test("the six sides look exactly along the axes", () => {
  const { walker } = navigatorAtOrigin();
  walker.toggleProjection();
  for (const { name, forward } of SIDES) {
    walker.frameFrom({ min: [-1, -1, -1], max: [1, 1, 1] }, forward);
    assert.ok(distance(walker.forward, forward) < 2e-6, `${name}: ${walker.forward}`);
    // Walls of that direction are lines.
    const [from, to] = [-1, 1].map(
      (side) => forward.map((part) => side * Math.round(part)) as unknown as Point,
    );
    assert.ok(from && to && span(walker, from, to) < 0.1, name);
  }
});

test("walking and flying take perspective, and other views their own projection", () => {
  const { walker } = navigatorAtOrigin();
  walker.goTo([0, 0, 5], [0, 0, -1]);
  for (const mode of ["walk", "fly"] as const) {
    walker.toggleProjection();
    walker.setMode(mode);
    assert.deepEqual([walker.projection.peek(), walker.mode.peek()], ["perspective", mode]);
    assert.ok(distance(walker.eye, [0, 0, 5]) < 1e-9, `${walker.eye}`);
  }
  walker.jumpTo({ eye: [0, 0, 900], forward: [0, 0, -1], vfovDeg: PARALLEL_DEG, mode: "fly" });
  assert.deepEqual([walker.projection.peek(), walker.mode.peek()], ["parallel", "orbit"]);
  walker.goBack();
  assert.deepEqual([walker.vfovDeg, walker.mode.peek()], [60, "fly"]);
  // A point is as large as with the other lens from that distance.
  walker.lookAt([1, 2, 3], 4);
  const height = through(walker).heightAt(placeOf(walker, [1, 2, 3]).depth);
  walker.toggleProjection();
  walker.lookAt([1, 2, 3], 4);
  assert.ok(Math.abs(through(walker).heightAt(placeOf(walker, [1, 2, 3]).depth) / height - 1) < 1e-9);
});

test("a parallel view travels in a link, and in the orthogonal camera of a note", () => {
  const { walker } = navigatorAtOrigin();
  walker.toggleProjection();
  walker.frameFrom({ min: [-1, -1, -1], max: [1, 1, 1] }, [-1, -0.8, -1]);
  const { eye, forward, vfovDeg } = walker;
  const view = {
    sections: [],
    hidden: ObjectSet.EMPTY,
    isolated: undefined,
    seeThrough: ObjectSet.EMPTY,
    distances: [],
    colouring: { by: "", paints: [] },
  };
  const scene = { name: "plant", fingerprint: "0".repeat(32) };
  const read = decodeViewpoint(encodeViewpoint({ scene, eye, forward, vfovDeg, mode: "orbit", view }));
  assert.deepEqual([read?.eye, read?.forward, read?.vfovDeg], [eye, forward, PARALLEL_DEG]);
  const other = navigatorAtOrigin().walker;
  assert.ok(read);
  other.jumpTo(read);
  assert.equal(other.projection.peek(), "parallel");
  for (const point of [
    [0, 0, 0],
    [1, -1, 0.5],
  ] as const) {
    const [a, b] = [placeOf(walker, point), placeOf(other, point)];
    assert.ok(Math.hypot(a.x - b.x, a.y - b.y) < 1e-6, `${point}`);
    const camera = orthogonalOf(eye, forward, point, 20);
    assert.ok(Math.abs(distance(camera.eye, point) - 20) < 0.1, "other programs see it from near by");
    assert.ok(Math.abs(camera.height - through(walker).heightAt(a.depth)) < 1e-9);
    assert.ok(
      distance(poseOf(camera, [3 * forward[0], 3 * forward[1], 3 * forward[2]], point).eye, eye) < 1e-6,
    );
  }
  // A text form may round.
  assert.ok(isParallel(0.0573) && isParallel(vfovDeg * (1 + 1e-12)) && !isParallel(0.01) && !isParallel(1));
});

test("an eye that swings around what it shows is foreseen on its circle", () => {
  const prediction = new Prediction();
  const at = (time: number) => {
    const [heading, pitch] = [time / 500, -0.2];
    return { eye: beyond([1, 2, 3], directionOf(heading, pitch), -HEIGHTS), heading, pitch, ahead: HEIGHTS };
  };
  for (let time = 0; time <= 100; time += 10) {
    prediction.add(time, at(time));
  }
  const foreseen = prediction.after(100);
  const { eye, heading } = at(200);
  assert.ok(foreseen && Math.abs(foreseen.heading - heading) < 1e-9);
  // A straight way would lead it tens of picture heights past that.
  assert.ok(distance(foreseen.eye, eye) < 1e-6, `${foreseen.eye} for ${eye}`);
});

test("a parallel navigator says what it swings around", () => {
  const { walker } = navigatorAtOrigin();
  assert.equal(walker.pose.ahead, 0);
  walker.toggleProjection();
  walker.frameFrom({ min: [-1, -1, -1], max: [1, 1, 1] }, [0, 0, -1]);
  assert.ok(Math.abs(walker.pose.ahead - distance(walker.eye, [0, 0, 0])) < 1e-9);
  assert.ok(distance(walker.focus, [0, 0, 0]) < 1e-9, `${walker.focus}`);
});
