import assert from "node:assert/strict";
import test from "node:test";
import { sampling, widerBy } from "../src/viewer/sampling.ts";

const MOST = { width: 4096, height: 4096 };

test("pixels of an eye at rest are as large as those of the picture, and those of a moving one wider", () => {
  const picture = { width: 100, height: 31 };
  assert.deepEqual(sampling(picture, 2, false, MOST), {
    pictureSize: { width: 150, height: 47 },
    levelRule: { epsilon: 2, fewPixels: false },
  });
  // The silhouette error is the same share of the picture as before.
  assert.deepEqual(sampling(picture, 3, true, MOST), {
    pictureSize: { width: 100, height: 31 },
    levelRule: { epsilon: 2, fewPixels: false },
  });
  assert.equal(widerBy(picture), 47 / 31);
  assert.deepEqual(sampling({ width: 1, height: 1 }, 2, true, MOST).pictureSize, { width: 1, height: 1 });
});

test("no picture is larger than the service takes, and silhouettes are as fine as before", () => {
  const screen = { width: 3840, height: 2160 };
  const { pictureSize, levelRule } = sampling(screen, 2, false, MOST);
  assert.deepEqual(pictureSize, { width: 4096, height: 2304 });
  // Culling pixels grow in proportion as their error shrinks.
  assert.equal(levelRule.epsilon, (2 * 4096) / (1.5 * 3840));
  for (const [width, height] of [
    [3840, 2160],
    [1, 8000],
    [8000, 1],
    [2731, 2731],
    [10_000, 10_000],
  ] as const) {
    for (const most of [MOST, { width: 100, height: 7 }, { width: 1, height: 1 }]) {
      for (const isMoving of [false, true]) {
        const { pictureSize } = sampling({ width, height }, 2, isMoving, most);
        assert.ok(pictureSize.width >= 1 && pictureSize.width <= most.width, `${width} ${most.width}`);
        assert.ok(pictureSize.height >= 1 && pictureSize.height <= most.height, `${height} ${most.height}`);
      }
    }
  }
});
