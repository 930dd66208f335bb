import assert from "node:assert/strict";
import { test } from "node:test";
import { NOTHING } from "../src/draw/device.ts";
import type { Drawable } from "../src/draw/model.ts";
import { Spans } from "../src/drive/audit.ts";
import { wrongShare } from "../src/viewer/wrongPixels.ts";
import { drawableAt } from "./drawScene.ts";

/** A drawable from `x` on, one metre in each direction. */
function drawable(id: number, object: number, x: number, more: Partial<Drawable> = {}): Drawable {
  const box = { worldMin: [x, 0, 0], worldMax: [x + 1, 1, 1] } as const;
  return drawableAt(id, [0, 0, 0], { object, ...box, ...more });
}

test("a pixel is wrong where it shows another object, not where it shows another level of the same", () => {
  const fine = drawable(1, 7, 0);
  const coarse = drawable(2, 7, 0.001);
  const other = drawable(3, 8, 5);
  // Objects 7 to 9 in one.
  const group = drawable(4, 7, 0, { objects: 3, worldMax: [6, 1, 1] });
  const elsewhere = drawable(5, 20, 50);
  const all = [fine, coarse, other, group, elsewhere];
  const share = (shown: number[], exact: number[]) =>
    wrongShare(Uint32Array.from(shown), Uint32Array.from(exact), all);
  assert.equal(share([1, 1, 3, NOTHING], [1, 2, 3, NOTHING]), 0);
  assert.equal(share([1, 1, 3, NOTHING], [3, 2, 1, 1]), 0.75);
  assert.equal(share([4, 4, 4, 1], [1, 3, 5, 4]), 0.25, "a group shows each of its objects, and no other");
  assert.equal(share([NOTHING, NOTHING], [NOTHING, 1]), 0.5);
  assert.equal(share([], []), 0);
});

test("the longest time of several in which something holds", () => {
  const spans = new Spans();
  for (const [at, holds] of [
    [0, true],
    [10, true],
    [25, false],
    [40, true],
    [50, false],
    [90, false],
  ] as const) {
    spans.add(at, holds);
  }
  assert.equal(spans.longest, 25);
});
