/** The plain words of the panel "Status". */

import assert from "node:assert/strict";
import { test } from "node:test";
import { type PageState, plainRows } from "../src/panels/plainRows.ts";

const GOOD: PageState = {
  isLinked: true,
  losses: 0,
  latency: 41.6,
  isExact: true,
  framesPerSecond: 0,
  memory: 45 * 2 ** 20,
  mostMemory: 512 * 2 ** 20,
  service: "plant.example:7480",
  scene: "huldra",
  objects: 12_345,
};

function said(change: Partial<PageState>): Readonly<Record<string, unknown>> {
  return Object.fromEntries(plainRows({ ...GOOD, ...change }));
}

test("the status says in plain words how the link and the picture are", () => {
  assert.deepEqual(said({}), {
    Link: "good, an answer takes 42 ms",
    Picture: "complete and exact",
    "Frames per second": "none needed: nothing moves",
    Memory: "45 of 512 MiB",
    Service: "plant.example:7480",
    Scene: "huldra, 12,345 parts",
  });
  const moving = said({ isExact: false, framesPerSecond: 29.7, latency: 350 });
  assert.equal(moving.Link, "slow, an answer takes 350 ms");
  assert.equal(moving.Picture, "complete and exact once you rest");
  assert.equal(moving["Frames per second"], "30");
});

test("the status says that the link is lost, and how often it was", () => {
  const lost = said({ isLinked: false, losses: 1, isExact: false });
  assert.equal(lost.Link, "none now, the page tries again by itself; lost 1 time so far");
  assert.equal(lost.Picture, "may lack parts until the link is back");
  // A picture that was exact before the link was lost still is.
  assert.equal(said({ isLinked: false, losses: 1 }).Picture, "complete and exact");
  assert.equal(said({ losses: 2 }).Link, "good, an answer takes 42 ms; lost 2 times so far");
});
