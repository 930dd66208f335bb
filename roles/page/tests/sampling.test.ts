import assert from "node:assert/strict";
import test from "node:test";
import { sampling, widerBy } from "../src/viewer/sampling.ts";

test("pixels of an eye at rest are as large as those of the picture, and those of a moving one wider", () => {
  const picture = { width: 100, height: 31 };
  assert.deepEqual(sampling(picture, 2, false), {
    pictureSize: { width: 150, height: 47 },
    levelRule: { epsilon: 2, fewPixels: false },
  });
  // A silhouette may be off by as much of the picture as before.
  assert.deepEqual(sampling(picture, 3, true), {
    pictureSize: { width: 100, height: 31 },
    levelRule: { epsilon: 2, fewPixels: false },
  });
  assert.equal(widerBy(picture), 47 / 31);
  assert.deepEqual(sampling({ width: 1, height: 1 }, 2, true).pictureSize, { width: 1, height: 1 });
});
