/** The parts of drawing that need no browser: allocation, cameras, boxes, normals, visible sides. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { Allocator, type Place } from "../src/draw/allocator.ts";
import { boundsOf } from "../src/draw/arena.ts";
import { BOTH, FRONT, facingOf, MIRRORED } from "../src/draw/facing.ts";
import type { Camera } from "../src/draw/model.ts";
import { DrawOrder } from "../src/draw/order.ts";
import { moveIndices } from "../src/draw/page.ts";
import { View } from "../src/draw/view.ts";
import { Gaze } from "../src/navigate/gaze.ts";
import { BOTH_SIDES, FRONT_SIDE, isOfSolids } from "../src/proto/sides.ts";
import { type Point, pointOf } from "../src/space/point.ts";
import { randomOf, range } from "../wire/tests/support.ts";
import { AHEAD, box, cameraAt, drawableAt, folded, UPRIGHT } from "./drawScene.ts";

test("places never overlap, and what is given back can be taken again", () => {
  for (let seed = 1; seed <= 20; seed += 1) {
    const random = randomOf(seed);
    const capacity = 1 + random(1000);
    const allocator = new Allocator(capacity);
    /** The owner of each unit; 0 is free. */
    const owners = new Uint32Array(capacity);
    const taken = new Map<number, Place>();
    for (let step = 1; step <= 500; step += 1) {
      const [number] = [...taken.keys()].slice(random(Math.max(1, taken.size)));
      const place = number === undefined ? undefined : taken.get(number);
      if (number !== undefined && place !== undefined && random(2) === 0) {
        allocator.give(place);
        taken.delete(number);
        owners.fill(0, place.offset, place.offset + place.length);
      } else {
        const length = 1 + random(60);
        const gaps = freeLengths(owners);
        const got = allocator.take(length);
        const fitting = gaps.filter((gap) => gap.length >= length).map((gap) => gap.length);
        assert.equal(got === undefined, fitting.length === 0, `seed ${seed}, step ${step}`);
        if (got !== undefined) {
          assert.equal(got.length, length);
          const gap = gaps.find(({ offset }) => offset === got.offset);
          assert.equal(gap?.length, Math.min(...fitting), "the smallest free place");
          owners.fill(step, got.offset, got.offset + length);
          taken.set(step, got);
        }
      }
      assert.equal(allocator.used, owners.filter((owner) => owner > 0).length);
      assert.equal(allocator.gaps, freeLengths(owners).length, "neighbours are joined");
    }
    for (const place of taken.values()) {
      allocator.give(place);
    }
    assert.deepEqual([allocator.used, allocator.gaps], [0, 1]);
    assert.deepEqual(allocator.take(capacity), { offset: 0, length: capacity });
  }
});

/** The runs of zeros. */
function freeLengths(owners: Uint32Array): { offset: number; length: number }[] {
  const runs: { offset: number; length: number }[] = [];
  for (const [offset, owner] of owners.entries()) {
    const last = runs.at(-1);
    if (owner > 0) {
      continue;
    }
    if (last !== undefined && last.offset + last.length === offset) {
      last.length += 1;
    } else {
      runs.push({ offset, length: 1 });
    }
  }
  return runs;
}

test("nothing has a place in no room, and takes none", () => {
  const allocator = new Allocator(0);
  assert.equal(allocator.take(1), undefined);
  assert.deepEqual(allocator.take(0), { offset: 0, length: 0 });
  allocator.give({ offset: 0, length: 0 });
  assert.equal(allocator.gaps, 0);
});

test("the first corner of a triangle goes where the browser looks for what is flat", () => {
  const indices = Uint32Array.of(4, 5, 6, 6, 5, 7);
  const moved = (provoking: "first" | "last") => {
    const into = new Uint32Array(7);
    moveIndices(indices, 10, provoking, into);
    return [...into];
  };
  assert.deepEqual(moved("first"), [14, 15, 16, 16, 15, 17, 0]);
  assert.deepEqual(moved("last"), [15, 16, 14, 15, 17, 16, 0]);
});

test("near boxes come first, of those about as near what shows both sides, and then the lower number", () => {
  const boxed = (id: number, [x, y, z]: Point, sides = BOTH_SIDES) =>
    drawableAt(id, [0, 0, 0], { worldMin: [x, y, z], worldMax: [x + 1, y + 1, z + 1], sides });
  const drawables = [
    boxed(9, [5, 0, 0]),
    boxed(7, [-0.5, -0.5, -0.5]),
    boxed(3, [0, 0, 0]),
    boxed(4, [2, 0, 0]),
  ];
  const order = new DrawOrder();
  const places = (eye: Point, of: typeof drawables) => {
    const view = new View();
    view.set(cameraAt(eye), 100, 100);
    order.sort(view, of);
    return of.map((_, before) => order.place(before));
  };
  assert.deepEqual(places([0.1, 0.1, 0.1], drawables), [2, 1, 3, 0]);
  assert.deepEqual(places([5.5, 0.5, 0.5], drawables), [0, 3, 2, 1]);
  const random = randomOf(3);
  const many = Array.from({ length: 400 }, (_, at) =>
    boxed((at * 7919) % 4001, [random(4), random(4), random(4)], at % 3 === 0 ? FRONT_SIDE : BOTH_SIDES),
  );
  const away = (at: number) => {
    const [x = 0, y = 0, z = 0] = (many[at]?.worldMin ?? []).map((low) =>
      Math.max(low - 0.3, 0.3 - low - 1, 0),
    );
    return Math.fround(x * x + y * y + z * z);
  };
  const number = (at: number) => many[at]?.id ?? 0;
  const power = (at: number) => (away(at) === 0 ? -200 : Math.floor(Math.log2(away(at))));
  const isFront = (at: number) => (many[at]?.sides === FRONT_SIDE && away(at) > 0.0154 ? 1 : 0);
  const expected = [...many.keys()].sort(
    (a, b) => power(a) - power(b) || isFront(a) - isFront(b) || away(a) - away(b) || number(a) - number(b),
  );
  assert.deepEqual(places([0.3, 0.3, 0.3], many), expected);
});

test("a normal is folded as the wire says", () => {
  assert.deepEqual(folded([0, 0, 1]), [0, 0]);
  assert.deepEqual(folded([1, 0, 0]), [32767, 0]);
  assert.deepEqual(folded([0, -1, 0]), [0, -32767]);
  // Straight down is every corner of the square; this is one of them.
  assert.deepEqual(folded([0, 0, -1]), [32767, 32767]);
  // (0.25, -0.25) is mirrored in the line |x| + |y| = 1 to (0.75, -0.75).
  assert.deepEqual(folded([1, -1, -2]), [Math.round(0.75 * 32767), Math.round(-0.75 * 32767)]);
});

/** Quarter turns about the axes. */
const TURNS: readonly (readonly [Camera["orientation"], Point, Point])[] = [
  // Orientation, a point of the world seen from the origin, and where it is in camera space.
  [AHEAD, [1, 2, -3], [1, 2, -3]],
  // A quarter about y to the left: the camera looks along -x.
  [
    [0, Math.SQRT1_2, 0, Math.SQRT1_2],
    [-5, 1, -2],
    [2, 1, -5],
  ],
  // A quarter about x upwards: the camera looks along +y.
  [
    [Math.SQRT1_2, 0, 0, Math.SQRT1_2],
    [1, 7, 2],
    [1, 2, -7],
  ],
  // A quarter about z to the left: the picture's right is the world's +y.
  [
    [0, 0, Math.SQRT1_2, Math.SQRT1_2],
    [1, 4, -9],
    [4, -1, -9],
  ],
];

test("a point of the world is where the camera sees it", () => {
  for (const [orientation, point, expected] of TURNS) {
    const view = new View();
    view.set({ eye: [10, 20, 30], orientation, tanHalfFov: 0.5, near: 0.25 }, 300, 200);
    view.place(drawableAt(1, [10 + point[0], 20 + point[1], 30 + point[2]]));
    const seen = [3, 7, 11].map((at) => view.matrix[at] ?? 0);
    for (const [axis, coordinate] of expected.entries()) {
      assert.ok(Math.abs((seen[axis] ?? 0) - coordinate) < 1e-12, `${seen} for ${expected}`);
    }
    assert.deepEqual([view.tanX, view.tanY, view.near], [0.75, 0.5, 0.25]);
  }
});

test("the linear part goes column by column", () => {
  const view = new View();
  view.set(cameraAt([0, 0, 0]), 1, 1);
  view.place(drawableAt(1, [7, 8, 9], { linear: [1, 2, 3, 4, 5, 6, 10, 11, 12] }));
  assert.deepEqual([...view.matrix], [1, 4, 10, 7, 2, 5, 11, 8, 3, 6, 12, 9]);
});

test("what moves with the camera has the same matrix to the last bit", () => {
  const random = randomOf(5);
  // Multiples of a power of two near a millimetre, so that sums are exact.
  const coordinate = () => (random(1 << 20) - (1 << 19)) / 1024;
  const matrices = [0, 500_000].map(() => [] as number[]);
  for (let round = 0; round < 50; round += 1) {
    const [eye, origin] = [
      [coordinate(), coordinate(), coordinate()],
      [coordinate(), coordinate(), coordinate()],
    ] as const;
    const orientation = unit([random(1000) - 500, random(1000) - 500, random(1000) - 500, 1 + random(500)]);
    for (const [at, by] of [0, 500_000].entries()) {
      const moved = ([x = 0, y = 0, z = 0]: readonly number[]): Point => [x + by, y - by, z + by];
      const view = new View();
      view.set({ eye: moved(eye), orientation, tanHalfFov: 0.5, near: 0.1 }, 100, 100);
      view.place(drawableAt(1, moved(origin)));
      matrices[at]?.push(...view.matrix);
    }
  }
  assert.deepEqual(matrices[0], matrices[1]);
});

function unit([x, y, z, w]: readonly [number, number, number, number]): Camera["orientation"] {
  const length = Math.hypot(x, y, z, w);
  return [x / length, y / length, z / length, w / length];
}

test("a box is around its vertices", () => {
  assert.deepEqual([...boundsOf(box([2, 4, 8]).vertices)], [0, 0, 0, 1, 2, 4]);
  // At an odd offset in its memory as well.
  const { vertices } = box([2, 4, 8]);
  const odd = new Uint8Array(vertices.length + 1);
  odd.set(vertices, 1);
  assert.deepEqual([...boundsOf(odd.subarray(1))], [0, 0, 0, 1, 2, 4]);
  assert.deepEqual([...boundsOf(new Uint8Array(0))], [0, 0, 0, 0, 0, 0]);
});

test("a box is seen if any of it is in the picture", () => {
  const random = randomOf(9);
  const between = (low: number, high: number) => low + ((high - low) * random(1 << 20)) / (1 << 20);
  let [seen, unseen] = [0, 0];
  for (let round = 0; round < 3000; round += 1) {
    const view = new View();
    view.set(cameraAt([0, 0, 0], between(0.1, 2), 0.5), 100 + random(300), 100 + random(300));
    const linear = Array.from({ length: 9 }, () => between(-2, 2));
    view.place(drawableAt(1, [between(-20, 20), between(-20, 20), between(-25, 5)], { linear }));
    const bounds = Float64Array.from({ length: 6 }, (_, at) => (at < 3 ? between(-1, 1) : between(0, 2)));
    const sees = view.sees(bounds);
    for (let sample = 0; sample < 30; sample += 1) {
      const inside = [0, 1, 2].map((axis) => (bounds[axis] ?? 0) + between(-1, 1) * (bounds[3 + axis] ?? 0));
      const [x = 0, y = 0, z = 0] = [0, 4, 8].map((row) => {
        const [a = 0, b = 0, c = 0, d = 0] = view.matrix.subarray(row, row + 4);
        return a * (inside[0] ?? 0) + b * (inside[1] ?? 0) + c * (inside[2] ?? 0) + d;
      });
      const isShown = -z >= view.near && Math.abs(x) <= -z * view.tanX && Math.abs(y) <= -z * view.tanY;
      assert.ok(sees || !isShown, `round ${round}`);
    }
    seen += sees ? 1 : 0;
    unseen += sees ? 0 : 1;
  }
  assert.ok(seen > 300 && unseen > 300, `${seen} are seen, ${unseen} are not`);
});

test("a box beside each side of the picture is not seen", () => {
  const view = new View();
  view.set(cameraAt([0, 0, 0], 0.5, 1), 200, 100);
  const bounds = Float64Array.of(0, 0, 0, 1, 1, 1);
  const isSeen = (x: number, y: number, z: number) => {
    view.place(drawableAt(1, [x, y, z]));
    return view.sees(bounds);
  };
  // At a distance of 10 the picture is 20 wide and 10 high; the box reaches to 1, and slants add less than 1.
  for (const [axis, inside, outside] of [
    [0, 10.9, 12.1],
    [0, -10.9, -12.1],
    [1, 5.9, 6.6],
    [1, -5.9, -6.6],
    [2, -0.1, 0.1],
  ] as const) {
    const at = (far: number) => pointOf((other) => (other === axis ? far : other === 2 ? -10 : 0));
    assert.deepEqual([isSeen(...at(inside)), isSeen(...at(outside))], [true, false], `${at(inside)}`);
  }
});

test("a solid shows its front alone, unless it is flat or the near plane cuts it", () => {
  const view = new View();
  view.set(cameraAt([0, 0, 0], 0.5, 1), 100, 100);
  const facing = (distance: number, sides: number, linear: readonly number[] = UPRIGHT) => {
    const box = { worldMin: [-1, -1, -distance - 1] as const, worldMax: [1, 1, 1 - distance] as const };
    return facingOf(drawableAt(1, [0, 0, -distance], { sides, linear, ...box }), view);
  };
  assert.equal(facing(5, FRONT_SIDE), FRONT);
  assert.equal(facing(5, BOTH_SIDES), BOTH);
  assert.equal(facing(5, FRONT_SIDE, [-1, 0, 0, 0, 1, 0, 0, 0, 1]), MIRRORED);
  assert.equal(facing(5, FRONT_SIDE, [-1, 0, 0, 0, 1, 0, 0, 0, -1]), FRONT);
  assert.equal(facing(5, FRONT_SIDE, [1, 0, 0, 0, 1, 0, 0, 0, 0]), BOTH);
  // Swapping two axes mirrors, rotating three does not.
  assert.equal(facing(5, FRONT_SIDE, [0, 1, 0, 1, 0, 0, 0, 0, 1]), MIRRORED);
  assert.equal(facing(5, FRONT_SIDE, [1, 0, 0, 0, 0, 1, 0, 1, 0]), MIRRORED);
  assert.equal(facing(5, FRONT_SIDE, [0, 0, 1, 0, 1, 0, 1, 0, 0]), MIRRORED);
  assert.equal(facing(5, FRONT_SIDE, [0, 1, 0, 0, 0, 1, 1, 0, 0]), FRONT);
  // The near plane's corners are at the root of 1.5, and the box begins one metre before its middle.
  assert.deepEqual([facing(2.23, FRONT_SIDE), facing(2.25, FRONT_SIDE)], [BOTH, FRONT]);
});

test("eyes see into what is open as far as the wire says, and no farther", () => {
  // A box of 2 m, whose diagonal is the root of 12.
  const box = { worldMin: [-1, -1, -1] as const, worldMax: [1, 1, 1] as const };
  const facing = (sides: number, ...eye: Point) => {
    const view = new View();
    view.set(cameraAt(eye, 0.5, 1e-3), 100, 100);
    return facingOf(drawableAt(1, [0, 0, 0], { sides, ...box }), view);
  };
  // Open below: 15 at the lower end of y and at both of x and z.
  const below = 0xf0_ffff;
  assert.deepEqual([facing(below, 0, 1.1, 0), facing(below, 0, 0.9, 0)], [FRONT, BOTH]);
  assert.deepEqual([facing(below, 900, 1.1, -900), facing(below, 900, -900, 0)], [FRONT, BOTH]);
  // A diagonal farther at the upper end of z, and a sixty-fourth of it at the lower one.
  const far = 0x70_0100;
  const end = 1 + Math.sqrt(12);
  assert.deepEqual([facing(far, 0, 0, end - 0.01), facing(far, 0, 0, end + 0.01)], [BOTH, FRONT]);
  const start = -1 - Math.sqrt(12) / 64;
  assert.deepEqual([facing(far, 0, 0, start + 0.01), facing(far, 0, 0, start - 0.01)], [BOTH, FRONT]);
  assert.deepEqual([facing(far, 0.999, 0, 0), facing(far, 1.01, 0, 0)], [BOTH, FRONT]);
  assert.deepEqual([0, far, 0xee_eeee, below, BOTH_SIDES].map(isOfSolids), [true, true, true, false, false]);
  const openAtOne = range(0, 6).map((face) => 15 << (4 * face));
  assert(!openAtOne.some(isOfSolids));
});

test("a walker's camera looks along its own -z", () => {
  const view = new View();
  const { orientation } = new Gaze([1, 0, 0]);
  view.set({ eye: [0, 0, 0], orientation, tanHalfFov: 0.5, near: 0.1 }, 10, 10);
  for (const [axis, expected] of [0, 0, -1].entries()) {
    assert.ok(Math.abs(view.along(axis, 1, 0, 0) - expected) < 1e-12);
  }
});
