import assert from "node:assert/strict";
import { test } from "node:test";
import { Samples } from "../src/viewer/samples.ts";

test("a share of samples is not above what is told", () => {
  const samples = new Samples();
  assert.equal(samples.share(0.5), 0);
  for (const sample of [5, 1, 4, 2, 3]) {
    samples.add(sample);
  }
  assert.deepEqual(
    [0, 0.2, 0.21, 0.5, 0.95, 1].map((share) => samples.share(share)),
    [1, 1, 2, 3, 5, 5],
  );
});
