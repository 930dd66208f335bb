import assert from "node:assert/strict";
import { test } from "node:test";
import { Projection } from "../src/draw/projection.ts";
import { Flight } from "../src/navigate/flight.ts";
import { framingEye } from "../src/navigate/framing.ts";
import { Gaze } from "../src/navigate/gaze.ts";
import { Ground, type Solid } from "../src/navigate/ground.ts";
import { addGamepad, Keys, still } from "../src/navigate/motion.ts";
import { approach, pan, turnAbout } from "../src/navigate/orbit.ts";
import { mostOpen } from "../src/navigate/sides.ts";
import { STANDARD_VIEWS } from "../src/navigate/standardViews.ts";
import { Tile } from "../src/navigate/tile.ts";
import { Walk } from "../src/navigate/walk.ts";
import { centreOf, cornersOf } from "../src/space/box.ts";
import type { Point } from "../src/space/point.ts";
import { navigatorAtOrigin } from "./atOrigin.ts";

/** Boxes on the ground: the solid spans at a place, by lower and upper ends. */
function world(spans: (x: number, z: number) => readonly number[]): Solid {
  return { cell: 0.1, column: (x, z) => Float64Array.from(spans(x, z)) };
}

/** Pseudo-random numbers from 0 to below 1. */
function shareOf(seed: number): () => number {
  let last = seed;
  return () => {
    last = (last * 48271) % 0x7fff_ffff;
    return last / 0x7fff_ffff;
  };
}

const FLOOR = [-0.2, 0];
const isIn = (at: number, low: number, high: number) => at >= low && at < high;

/** A person standing on a floor at the origin. */
function person(solid: Solid): Walk {
  const walk = new Walk([0, 1.7, 0], 1.7);
  walk.step(0.1, 0, 0, solid);
  assert.ok(walk.isStanding);
  return walk;
}

/** Walks towards +x at 1.4 m/s for this many seconds, at 20 pictures a second. */
function ahead(walk: Walk, seconds: number, solid: Solid): void {
  for (let time = 0; time < seconds; time += 0.05) {
    walk.step(0.05, 1.4 * 0.05, 0, solid);
  }
}

test("a person walks on a floor, and the eye stays at its height", () => {
  const solid = world(() => FLOOR);
  const walk = person(solid);
  ahead(walk, 2, solid);
  assert.ok(Math.abs(walk.feet[0] - 2.8) < 0.1, `${walk.feet}`);
  assert.equal(walk.eye[1], 1.7);
  assert.equal(walk.step(0.05, 0, 0, solid), false);
});

test("a wall stops who walks against it, and who walks along it slides", () => {
  const solid = world((x) => (isIn(x, 2, 2.2) ? [...FLOOR, 0, 3] : FLOOR));
  const walk = person(solid);
  ahead(walk, 5, solid);
  assert.ok(isIn(walk.feet[0], 1.6, 2 - 0.22 + 1e-9), `${walk.feet}`);
  for (let part = 0; part < 20; part += 1) {
    walk.step(0.05, 0.05, 0.05, solid);
  }
  assert.ok(walk.feet[0] < 1.8 && walk.feet[2] > 0.9, `${walk.feet}`);
});

test("stairs of 20 and of 40 cm are climbed, a wall of 60 cm is not", () => {
  for (const [rise, expected] of [
    [0.2, 2],
    [0.4, 4],
    [0.6, 0],
  ] as const) {
    const stairs = world((x) => [-0.2, Math.max(0, Math.min(10, Math.ceil((x - 1) / 0.35))) * rise]);
    const walk = person(stairs);
    ahead(walk, 6, stairs);
    assert.ok(Math.abs(walk.feet[1] - expected) < 1e-9, `${rise}: ${walk.feet}`);
    assert.ok(Math.abs(walk.eye[1] - walk.feet[1] - 1.7) < 0.3, `${rise}: ${walk.eye}`);
    // And down again, without a fall.
    for (let time = 0; time < 8 && expected > 0; time += 0.05) {
      walk.step(0.05, -1.4 * 0.05, 0, stairs);
      assert.ok(walk.isStanding);
    }
    assert.ok(Math.abs(walk.feet[1]) < 1e-9, `${rise}: ${walk.feet}`);
  }
});

test("a door of 80 cm lets a person through, one of 30 cm or below the head does not", () => {
  for (const [width, height, passes] of [
    [0.8, 2, true],
    [0.3, 2, false],
    [0.8, 1.5, false],
  ] as const) {
    const solid = world((x, z) => {
      const isDoor = Math.abs(z) < width / 2;
      return isIn(x, 2, 2.2) ? (isDoor ? [...FLOOR, height, 3] : [...FLOOR, 0, 3]) : FLOOR;
    });
    const walk = person(solid);
    ahead(walk, 5, solid);
    assert.equal(walk.feet[0] > 3, passes, `${width} x ${height}: ${walk.feet}`);
  }
});

test("who walks over an edge falls, and lands where the ground is", () => {
  const solid = world((x) => (x < 1 ? FLOOR : [-5.2, -5]));
  const walk = person(solid);
  ahead(walk, 1.2, solid);
  assert.ok(!walk.isStanding && walk.feet[1] < 0);
  ahead(walk, 2, solid);
  assert.ok(walk.isStanding);
  assert.equal(walk.feet[1], -5);
});

test("without any ground nobody falls, and where it is not known yet nobody goes", () => {
  const nothing = world(() => []);
  const walk = new Walk([0, 1.7, 0], 1.7);
  walk.step(3, 0, 0, nothing);
  assert.deepEqual([walk.feet[1], walk.isHovering], [0, true]);
  const edge: Solid = { cell: 0.1, column: (x) => (x < 1 ? Float64Array.from(FLOOR) : undefined) };
  const waits = person(edge);
  ahead(waits, 3, edge);
  assert.ok(waits.feet[0] < 1 && waits.feet[1] === 0, `${waits.feet}`);
  assert.ok(!waits.isHovering);
});

test("who walks off the last floor hovers until there is a floor again", () => {
  const solid = world((x) => (isIn(x, 1, 3) ? [] : FLOOR));
  const walk = person(solid);
  const unknown: Solid = { cell: 0.1, column: () => undefined };
  ahead(walk, 1.5, solid);
  assert.deepEqual([walk.isHovering, walk.feet[1]], [true, 0]);
  // It is not forgotten where nothing is known yet, or the eye is put elsewhere.
  walk.step(0.05, 0, 0, unknown);
  walk.place(walk.eye);
  assert.ok(walk.isHovering);
  ahead(walk, 1.5, solid);
  assert.ok(!walk.isHovering && walk.isStanding, `${walk.feet}`);
});

test("a jump is 40 cm high, and a ceiling ends it", () => {
  for (const [ceiling, most] of [
    [9, 0.4],
    [1.9, 0.13],
  ] as const) {
    const solid = world(() => [...FLOOR, ceiling, ceiling + 1]);
    const walk = person(solid);
    walk.jump();
    let highest = 0;
    for (let time = 0; time < 1.5; time += 0.01) {
      walk.step(0.01, 0, 0, solid);
      highest = Math.max(highest, walk.feet[1]);
    }
    assert.ok(isIn(highest, most - 0.06, most + 0.01), `${ceiling}: ${highest}`);
    assert.equal(walk.feet[1], 0);
  }
});

test("who begins within something gets out of it", () => {
  const solid = world((x) => (x < 1 ? [...FLOOR, 0, 3] : FLOOR));
  const walk = new Walk([0, 1.7, 0], 1.7);
  ahead(walk, 3, solid);
  assert.ok(walk.feet[0] > 1.5, `${walk.feet}`);
});

test("no way leads through walls, whatever is wanted and however long a picture takes", () => {
  // A room of 4 by 4 metres with a pillar and a step in it.
  const solid = world((x, z) => {
    const isWall = Math.abs(x) > 2 || Math.abs(z) > 2 || (isIn(x, 0.5, 0.8) && isIn(z, 0.5, 0.8));
    return isWall ? [-0.2, 3] : [-0.2, isIn(x, -2, -1) ? 0.3 : 0];
  });
  const random = shareOf(7);
  const walk = person(solid);
  for (let picture = 0; picture < 3000; picture += 1) {
    const [x, z] = [6 * (random() - 0.5), 6 * (random() - 0.5)];
    if (random() < 0.1) {
      walk.jump();
    }
    walk.step(0.1 * random(), x, z, solid);
    const [at, up, back] = walk.feet;
    assert.ok(Math.abs(at) <= 1.79 && Math.abs(back) <= 1.79 && up >= 0, `${picture}: ${walk.feet}`);
    assert.ok(Math.hypot(at - 0.65, back - 0.65) > 0.36, `${picture}: ${walk.feet} is within the pillar`);
  }
});

test("a small person walks in a small world", () => {
  const solid: Solid = {
    cell: 0.001,
    column: (x) => Float64Array.from(isIn(x, 0.02, 0.022) ? [0, 0.03] : [-1, 0]),
  };
  const walk = new Walk([0, 0.017, 0], 0.017);
  for (let time = 0; time < 5; time += 0.05) {
    walk.step(0.05, 0.014 * 0.05, 0, solid);
  }
  assert.ok(isIn(walk.feet[0], 0.016, 0.0179), `${walk.feet}`);
});

test("a tile tells its columns' spans, and what is none is refused", () => {
  const bytes = new ArrayBuffer(36 + 2 * 4 + 4 * 3);
  const view = new DataView(bytes);
  for (const [at, number] of [
    [0, 1000],
    [8, -2000],
    [16, -0.5],
  ] as const) {
    view.setFloat64(at, number, true);
  }
  view.setFloat32(24, 0.5, true);
  view.setFloat32(28, 0.25, true);
  view.setUint32(32, 2, true);
  // Nothing, one span, two, nothing.
  for (const [index, word] of [0, 1, 0, 2, 2, 1, 2, 4, 40, 0].entries()) {
    view.setUint16(36 + 2 * index, word, true);
  }
  const tile = new Tile(bytes);
  assert.deepEqual([...tile.column(1000.1, -2000)], []);
  assert.deepEqual([...tile.column(1000.6, -1999.9)], [-0.5, 0]);
  assert.deepEqual([...tile.column(1000.2, -1999.4)], [-0.25, 0, 0.5, 9.5]);
  assert.deepEqual([...tile.column(1000.9, -1999.1)], []);
  assert.throws(() => new Tile(bytes.slice(0, 44)), RangeError);
  view.setUint32(32, 1 << 20, true);
  assert.throws(() => new Tile(bytes), RangeError);
});

test("the ground is asked for once, and again where it did not come", async () => {
  const asked: string[] = [];
  const service = {
    tile: (x: number, z: number) => {
      asked.push(`${x},${z}`);
      return Promise.reject(new Error("gone"));
    },
  };
  const ground = new Ground(service, 6.4);
  assert.ok(Math.abs(ground.cell - 0.1) < 1e-15);
  assert.equal(ground.column(-0.1, 7), undefined);
  assert.equal(ground.column(-0.1, 7), undefined);
  assert.deepEqual(asked, ["-1,1"]);
  ground.fetchAround(-0.1, 7);
  assert.equal(asked.length, 9);
});

test("keys and a gamepad say what a person wants", () => {
  const keys = new Keys();
  assert.ok(keys.press("KeyW", true) && keys.press("ShiftLeft", true) && !keys.press("KeyX", true));
  const motion = still();
  keys.add(motion);
  assert.deepEqual([motion.ahead, keys.isFast], [1, true]);
  const buttons = Array.from({ length: 8 }, (_, index) => ({ value: index === 7 ? 1 : 0 }));
  const pad = {
    connected: true,
    mapping: "standard",
    axes: [0.1, -1, 0.575, 0],
    buttons,
  } as unknown as Gamepad;
  const padded = still();
  addGamepad(padded, [null, pad]);
  assert.ok(Math.abs(padded.turn + 0.5) < 1e-12, `${padded.turn}`);
  assert.deepEqual([padded.ahead, padded.right, padded.up], [1, 0, 1]);
  keys.press("KeyD", true);
  keys.press("KeyD", false);
  const tapped = still();
  keys.add(tapped);
  assert.equal(tapped.right, 1, "a tap between two pictures counts");
  keys.release();
  const none = still();
  keys.add(none);
  assert.deepEqual(none, still());
});

test("a flight begins when it is ready, arrives in time, and ends with any input", () => {
  const { walker, events } = navigatorAtOrigin();
  const to = { eye: [0, -8, -40], forward: [1, 0, 0] } as const;
  let isReady = false;
  walker.goTo([0, 8, 40], [-1, -1, 0]);
  walker.fly(to, "orbit", 2, () => isReady);
  walker.step(0.1);
  assert.deepEqual(walker.eye, [0, 8, 40], "it waits");
  isReady = true;
  const heights = Array.from({ length: 21 }, () => {
    walker.step(0.1);
    return walker.eye[1];
  });
  assert.ok(
    heights.every((height, at) => at === 0 || height <= (heights[at - 1] ?? 0)),
    `${heights}`,
  );
  assert.ok(Math.abs((heights[9] ?? 0) - 0) < 1e-9, `half of the way at half of the time: ${heights}`);
  assert.deepEqual([walker.eye, walker.mode.peek()], [to.eye, "orbit"]);
  assert.ok(Math.abs(walker.forward[0] - 1) < 1e-12);
  // It turns the shorter way, also across the heading of half a turn.
  const flight = new Flight(
    { eye: [0, 0, 0], forward: [-0.1, 0, 1] },
    { eye: [0, 0, 0], forward: [0.1, 0, 1] },
    2,
  );
  assert.ok(flight.after(1).forward[2] > 0.999);
  for (const kind of ["keydown", "pointerdown", "wheel"]) {
    walker.goTo([0, 8, 40], [0, 0, -1]);
    walker.fly(to, "walk", 2, () => true);
    walker.step(0.2);
    events.dispatchEvent(Object.assign(new Event(kind), { code: "", ctrlKey: true }));
    const { eye } = walker;
    walker.step(0.2);
    assert.deepEqual([walker.eye, walker.mode.peek()], [eye, "orbit"], kind);
  }
});

test("jumps can be gone back and forward, exactly to where the eye was left", () => {
  const { walker } = navigatorAtOrigin();
  const box = { min: [4, 4, 4], max: [5, 5, 5] } as const;
  const { history } = walker;
  assert.deepEqual([history.canGoBack.value, history.canGoForward.value], [false, false]);
  walker.goTo([7, 8, 9], [0, 0, -1]);
  walker.setVfov(33);
  walker.frameFrom(box, [-1, 0, 0]);
  const framed = walker.eye;
  walker.jumpTo({ eye: [1, 1, 1], forward: [0, 0, 1], vfovDeg: 70, mode: "orbit" });
  walker.goTo([2, 1, 1], [0, 0, 1]);
  walker.goBack();
  assert.deepEqual([walker.eye, walker.vfovDeg, walker.mode.peek()], [framed, 33, "fly"]);
  walker.goBack();
  assert.deepEqual([walker.eye, walker.vfovDeg, history.canGoBack.value], [[7, 8, 9], 33, false]);
  walker.goBack();
  assert.deepEqual(walker.eye, [7, 8, 9], "there is nothing before it");
  walker.goBack(1);
  walker.goBack(1);
  assert.deepEqual([walker.eye, walker.mode.peek()], [[2, 1, 1], "orbit"]);
  // A new jump discards the places after this one.
  walker.goBack();
  walker.frameFrom(box, [0, 0, 1]);
  assert.deepEqual([history.canGoBack.value, history.canGoForward.value], [true, false]);
});

test("the standard views look along their axes, and from above the front is below", () => {
  for (const { name, forward } of STANDARD_VIEWS) {
    const gaze = new Gaze(forward);
    const length = Math.hypot(...forward);
    const cosine = gaze.forward.reduce((sum, part, axis) => sum + (part * (forward[axis] ?? 0)) / length, 0);
    assert.ok(cosine > 0.9999, `${name}: ${gaze.forward}`);
    if (name === "Top" || name === "Bottom") {
      assert.ok(Math.abs(gaze.heading) < 1e-9, `${name}: ${gaze.heading}`);
    }
  }
});

test("what was tapped before the eye goes to another place does not move it from there", () => {
  const { walker } = navigatorAtOrigin();
  walker.press("KeyW", true);
  walker.press("KeyW", false);
  walker.step(0.1);
  assert.ok(walker.eye[2] < 0, "a tap moves the eye");
  walker.press("KeyW", true);
  walker.press("KeyW", false);
  walker.goTo([1, 2, 3], [0, 0, -1]);
  walker.step(0.1);
  assert.deepEqual(walker.eye, [1, 2, 3]);
  // Keys that are still held continue to act.
  walker.press("KeyD", true);
  walker.goTo([1, 2, 3], [0, 0, -1]);
  walker.step(0.1);
  assert.ok(walker.eye[0] > 1);
});

test("a gaze never looks straight up, and its quaternion has length one", () => {
  const gaze = new Gaze([0, 0, -1]);
  assert.deepEqual(gaze.onGround(1, 0), [0, -1]);
  gaze.turn(0.3, 300);
  assert.ok(gaze.pitch < Math.PI / 2 && gaze.forward[1] > 0.99);
  assert.ok(Math.abs(Math.hypot(...gaze.orientation) - 1) < 1e-12);
  gaze.along([0, 0, 0]);
  assert.ok(gaze.forward.every(Number.isFinite));
});

test("what is turned round stays where it shows, and comes nearer by shares", () => {
  const camera = (gaze: Gaze, eye: Point) => {
    const { orientation } = gaze;
    return new Projection({ eye, orientation, tanHalfFov: 0.5, near: 0.1 }, 800, 600);
  };
  const gaze = new Gaze([0.3, -0.2, -0.9]);
  const [eye, pivot]: [Point, Point] = [
    [1e5, 2, 3],
    [1e5 + 2, 1, -4],
  ];
  const before = camera(gaze, eye).place(pivot);
  const turned = turnAbout(pivot, eye, gaze, 0.7, 0.2);
  const after = camera(gaze, turned).place(pivot);
  assert.ok(before !== undefined && after !== undefined);
  for (const side of ["x", "y", "depth"] as const) {
    assert.ok(Math.abs(before[side] - after[side]) < 1e-6, `${side}: ${before[side]} ${after[side]}`);
  }
  assert.ok(Math.hypot(turned[0] - eye[0], turned[2] - eye[2]) > 3);
  const ways = [0.15, 9].map((share) => approach([10, 0, 0], [0, 0, 0], share, 1));
  assert.deepEqual(ways, [
    [1.5, 0, 0],
    [5, 0, 0],
  ]);
  assert.deepEqual(approach([10, 0, 0], [8.5, 0, 0], 0.5, 1), [9, 0, 0]);
  assert.deepEqual(approach([10, 0, 0], [9.5, 0, 0], 0.5, 1), [9.5, 0, 0], "it is near enough");
  assert.deepEqual(approach([10, 0, 0], [9.5, 0, 0], -1, 1), [9, 0, 0], "and goes away");
  const across = pan([0, 0, 0], new Gaze([0, 0, -1]), 2, 3);
  assert.ok(Math.hypot(across[0] - 2, across[1] - 3, across[2]) < 1e-12, `${across}`);
});

test("a box that is framed is all in the picture and fills it one way, from wherever it is seen", () => {
  const random = shareOf(5);
  for (let round = 0; round < 500; round += 1) {
    const min: Point = [1e4 * random(), 50 * random(), -1e4 * random()];
    const size = 10 ** (6 * random() - 3);
    const max: Point = [min[0] + size * random(), min[1] + size * random(), min[2] + size];
    const gaze = new Gaze([random() - 0.5, 1.6 * (random() - 0.5), random() - 0.5]);
    const [width, height] = [100 + 1900 * random(), 100 + 1900 * random()];
    const vfov = 20 + 80 * random();
    const tanY = Math.tan((vfov * Math.PI) / 360);
    const eye = framingEye(cornersOf({ min, max }), gaze, (tanY * width) / height, tanY);
    const { orientation } = gaze;
    const projection = new Projection({ eye, orientation, tanHalfFov: tanY, near: 1e-9 }, width, height);
    const places = cornersOf({ min, max }).map((corner) => {
      const place = projection.place(corner);
      assert.ok(place !== undefined, `${round}: a corner is behind the eye`);
      return place;
    });
    const [xs, ys] = [places.map(({ x }) => x), places.map(({ y }) => y)];
    const across = (Math.max(...xs) - Math.min(...xs)) / width;
    const down = (Math.max(...ys) - Math.min(...ys)) / height;
    assert.ok(Math.min(...xs) >= 0 && Math.max(...xs) <= width, `${round}: ${xs}`);
    assert.ok(Math.min(...ys) >= 0 && Math.max(...ys) <= height, `${round}: ${ys}`);
    const filled = Math.max(across, down);
    // A corner right before the eye keeps it a little farther away.
    assert.ok(filled < 0.861 && filled > (vfov < 60 ? 0.85 : 0.6), `${round}: it fills ${filled}`);
  }
});

test("what is a point is framed from a distance", () => {
  const point: Point = [1, 2, 3];
  const eye = framingEye([point], new Gaze([0, 0, -1]), 0.5, 0.5);
  assert.deepEqual([eye[0], eye[1]], [1, 2]);
  assert.ok(eye[2] > 3 && eye[2] < 3.1, `${eye}`);
  assert.deepEqual(centreOf({ min: [0, 0, 0], max: [2, 4, 6] }), [1, 2, 3]);
});

test("a projection tells what shows and where", () => {
  const { orientation } = new Gaze([0, 0, -1]);
  const projection = new Projection({ eye: [1, 2, 3], orientation, tanHalfFov: 1, near: 1e-9 }, 200, 100);
  const shown: Point = [5, 4, -1];
  assert.ok(projection.shows(shown) && Math.abs(projection.depthOf(shown) - 4) < 1e-12);
  const place = projection.place(shown);
  assert.ok(place && Math.abs(Math.hypot(place.x - 153, place.y - 29) - 5) < 1e-9);
  assert.ok(!projection.shows([1, 2, 7]) && !projection.shows([1, 8, -1]));
  assert.equal(projection.place([1, 2, 7]), undefined);
});

test("of the sides that are open, that one is gone to that is least far round", () => {
  const sides = [
    { from: [0, 0, 1], hidden: 1 },
    { from: [1, 0, 0], hidden: 0 },
    { from: [0, 0, -1], hidden: 0 },
    { from: [-0.6, 0, -0.8], hidden: 0.05 },
  ] as const;
  // It looks along -z, so from +z, where all is hidden.
  const [x, y, z] = mostOpen(sides, [0, 0, -7]) ?? [0, 0, 0];
  assert.deepEqual([x, y + 0, z + 0], [-1, 0, 0]);
  assert.equal(mostOpen([], [0, 0, -1]), undefined);
});
