/** Times of frames, as kept and shown. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { Timeline } from "../src/display/timeline.ts";
import { lanesOf, median, passesOf } from "../src/panels/timelineChart.tsx";
import type { Stats } from "../src/proto/stats.ts";

/** A culler's report of a frame that took this many milliseconds, and its passes on the device. */
function said(frame: number, or: number, hc: number, [drawing, pyramid, culling] = [0, 0, 0]): Stats {
  const ns = (milliseconds: number) => BigInt(milliseconds * 1e6);
  const start = 5_000_000_000n;
  const hcStart = start + ns(2 * or);
  const times = { orStart: start, orEnd: hcStart, orBusy: ns(or), hcStart };
  const device = { drawing: ns(drawing), pyramid: ns(pyramid), culling: ns(culling) };
  return { ...({} as Stats), ...times, device, frame, hcEnd: hcStart + ns(hc) };
}

test("work is of the frame that it names, and ends when its ids are there", () => {
  const timeline = new Timeline();
  timeline.came(7, 100, 130);
  timeline.came(8, 120, 150);
  timeline.said(said(7, 12, 3));
  // A replaced frame leaves nothing.
  timeline.said(said(6, 99, 99));
  assert.deepEqual(
    timeline.frames.map(({ frame, work }) => [frame, work]),
    [
      [7, { or: 12, hc: 3, onDevice: { occluders: 0, pyramid: 0, culling: 0 } }],
      [8, undefined],
    ],
  );
  const lanes = lanesOf(timeline.frames, [{ from: 131, to: 135 }]);
  const found = lanes.map(({ name, stretches }) => [name, ...stretches.map(({ from, to }) => [from, to])]);
  assert.deepEqual(found, [
    ["ids", [100, 130], [120, 150]],
    ["OR", [115, 127]],
    ["HC", [127, 130]],
    ["RVG", [131, 135]],
  ]);
});

test("passes of the culler's device are medians of the frames that have them", () => {
  const timeline = new Timeline();
  for (let frame = 0; frame < 4; frame += 1) {
    timeline.came(frame, frame, frame + 1);
  }
  assert.equal(passesOf(timeline.frames), "");
  timeline.said(said(0, 9, 9));
  assert.equal(passesOf(timeline.frames), "", "a device without timestamps");
  timeline.said(said(1, 9, 9, [4, 0, 0.25]));
  timeline.said(said(2, 9, 9, [12, 0, 0.5]));
  timeline.said(said(3, 9, 9, [6, 0, 0]));
  assert.equal(passesOf(timeline.frames), "occluders 6.0, culling 0.3");
});

test("the newest frames are kept", () => {
  const timeline = new Timeline();
  for (let frame = 1; frame <= 1000; frame += 1) {
    timeline.came(frame, frame, frame + 1);
  }
  assert.equal(timeline.frames.length, 64);
  assert.deepEqual([timeline.frames[0]?.frame, timeline.frames[63]?.frame], [937, 1000]);
});

test("the median is told, and nothing of none", () => {
  const of = (...lengths: readonly number[]) => median(lengths.map((to) => ({ from: 0, to })));
  assert.deepEqual([of(), of(3), of(30, 2, 11)], ["", "3.0", "11"]);
});
