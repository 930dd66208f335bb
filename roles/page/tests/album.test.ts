/** A bounded number of pictures is kept for audits, however long the walk. */

import assert from "node:assert/strict";
import { test } from "node:test";
import { Album, type Taken } from "../src/drive/audit.ts";
import type { Camera } from "../src/proto/camera.ts";

function taken(at: number): Taken {
  return { at, camera: {} as Camera, forward: [0, 0, -1], drawables: [], hasJumped: false };
}

test("pictures that are audited are even over the walk, and of a bounded number", () => {
  for (const [pictures, stride] of [
    [1, 1],
    [500, 1],
    [501, 2],
    [1000, 2],
    [1001, 4],
    [20_000, 64],
  ] as const) {
    const album = new Album();
    for (let at = 0; at < pictures; at += 1) {
      album.add(taken(at));
    }
    assert.deepEqual(
      album.pictures.map(({ at }) => at),
      Array.from({ length: pictures }, (_, at) => at),
    );
    const kept = album.pictures.flatMap(({ at, drawables }) => (drawables === undefined ? [] : [at]));
    const expected = Array.from({ length: Math.ceil(pictures / stride) }, (_, number) => number * stride);
    assert.deepEqual(kept, expected, `${pictures} pictures`);
    assert.ok(kept.length <= 501);
  }
});
