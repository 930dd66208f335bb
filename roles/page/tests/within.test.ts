import assert from "node:assert/strict";
import test from "node:test";
import { sampling, widerBy, within } from "../src/viewer/sampling.ts";

const MOST = { width: 8192, height: 8192 };

/** The view that a leader with a picture of this size has culled. */
function culled(width: number, height: number, tanHalfFov: number, isMoving = false) {
  const { pictureSize } = sampling({ width, height }, 1, isMoving, MOST);
  return { tanHalfFov: tanHalfFov * widerBy({ width, height }), pictureSize };
}

/** Numbers from 0 to 1, the same ones at each run. */
function* numbers(): Generator<number, never> {
  for (let state = 1; ; ) {
    state = (state * 48_271) % 2_147_483_647;
    yield state / 2_147_483_647;
  }
}

test("the picture of a follower is within the leader's set, and has no finer pixels", () => {
  const random = numbers();
  const next = (from: number, to: number) => from + (to - from) * random.next().value;
  const side = () => Math.round(next(1, 4000));
  for (let run = 0; run < 20_000; run += 1) {
    const set = culled(side(), side(), next(0.05, 3), run % 2 === 0);
    const { width, height } = set.pictureSize;
    const screen = { width: side(), height: side() };
    const most = next(0.05, 3);
    const picture = within(screen, most, set, set.pictureSize);
    const across = (picture.tanHalfFov * picture.width) / picture.height;
    const exact = 1 + 1e-12;
    assert(picture.tanHalfFov <= Math.min(most, set.tanHalfFov));
    assert(across <= (set.tanHalfFov * width * exact) / height);
    assert(picture.width <= screen.width && picture.height <= screen.height);
    // A picture of a single row may be narrower than a pixel of the set.
    if (picture.height > 1 && picture.width > 1) {
      const pixel = picture.tanHalfFov / picture.height;
      assert(pixel * exact >= set.tanHalfFov / height, JSON.stringify({ set, screen, picture }));
    }
  }
});

test("followers of the leader's size and of smaller ones see all that it sees", () => {
  const set = culled(300, 300, 0.5);
  for (const screen of [
    { width: 300, height: 300 },
    { width: 300, height: 200 },
    { width: 450, height: 300 },
  ]) {
    assert.deepEqual(within(screen, 0.5, set, set.pictureSize), { ...screen, tanHalfFov: 0.5 });
  }
});

test("a wider screen shows less height, and a larger one has the leader's pixels", () => {
  const set = culled(300, 300, 0.5);
  const wide = within({ width: 900, height: 200 }, 0.5, set, set.pictureSize);
  assert.deepEqual([wide.width, wide.height], [450, 100]);
  assert.equal(wide.tanHalfFov, (0.75 * 100) / 450);
  const large = within({ width: 1200, height: 1200 }, 0.5, set, set.pictureSize);
  assert.deepEqual(large, { width: 300, height: 300, tanHalfFov: 0.5 });
});
