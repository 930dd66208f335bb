import assert from "node:assert/strict";
import test from "node:test";
import { Following } from "../src/display/following.ts";
import { viewMessages } from "../src/proto/messages.ts";
import { viewStateOf } from "../src/proto/viewState.ts";

const LEADER = 7n;

/** A frame of the link, by a camera of this number in this view state. */
const frame = (number: number, camera: number, viewState = 0) => ({
  number,
  header: {
    eye: [0, 0, 0] as [number, number, number],
    orientation: [0, 0, 0, 1] as [number, number, number, number],
    tanHalfFov: 1,
    near: 0.1,
    frame: camera,
    viewState,
  },
  items: Uint32Array.of(camera),
});

const view = (width: number) =>
  viewStateOf({
    viewport: { width, height: 8 },
    levelRule: { epsilon: 1, fewPixels: false },
    batch: 256,
    coding: "changes",
    occlusionTest: "hzb",
  });

/** The cameras of sorted frames, and the widths of the leader's pictures. */
const seen = (sorted: ReturnType<Following["sort"]>) =>
  sorted.map(({ frame: { header }, led }) => [header.frame, led?.pictureSize.width]);

test("frames that come before the answer are kept until it is known whose they are", () => {
  const following = new Following();
  assert.deepEqual(seen(following.sort(frame(0, 50))), [[50, undefined]]);
  assert.equal(following.isAway, false);
  assert.deepEqual(following.follow(LEADER), { what: "follow", leader: LEADER });
  assert.equal(following.follow(LEADER), undefined);
  assert.equal(following.isAway, true);
  // One more of its own, and two of the leader, whose second view state is late.
  for (const early of [frame(1, 51), frame(2, 3), frame(3, 4, 1)]) {
    assert.deepEqual(following.sort(early), []);
  }
  assert(following.hear({ what: "followed", leader: LEADER, firstFrame: 2 }));
  for (const message of viewMessages(0, view(100))) {
    assert(following.hear(message));
  }
  assert.deepEqual(seen(following.sort()), [
    [51, undefined],
    [3, 100],
  ]);
  for (const message of viewMessages(1, view(200))) {
    following.hear(message);
  }
  assert.deepEqual(seen(following.sort()), [[4, 200]]);
  // The display goes on by itself.
  assert.deepEqual(following.follow(undefined), { what: "unfollow", leader: LEADER });
  assert.deepEqual(following.sort(frame(4, 5, 1)), []);
  assert.deepEqual(following.sort(frame(5, 52)), []);
  assert.equal(following.isAway, true);
  following.hear({ what: "unfollowed", leader: LEADER, firstFrame: 5 });
  assert.equal(following.isAway, false);
  assert.deepEqual(seen(following.sort()), [
    [5, 200],
    [52, undefined],
  ]);
});

test("a leader that leaves, or that nobody knows, leaves the display to itself", () => {
  const following = new Following();
  following.follow(LEADER);
  following.hear({ what: "unfollowed", leader: LEADER, firstFrame: 0 });
  assert.deepEqual([following.isAway, following.leader], [false, undefined]);
  following.follow(LEADER);
  following.hear({ what: "followed", leader: LEADER, firstFrame: 0 });
  assert.deepEqual([following.isAway, following.leader], [true, LEADER]);
  following.hear({ what: "unfollowed", leader: LEADER, firstFrame: 9 });
  assert.deepEqual([following.isAway, following.leader], [false, undefined]);
  assert.deepEqual(seen(following.sort(frame(9, 1))), [[1, undefined]]);
});

test("a late answer about another leader does not count", () => {
  const following = new Following();
  following.follow(LEADER);
  following.follow(8n);
  following.hear({ what: "followed", leader: LEADER, firstFrame: 0 });
  assert.deepEqual(following.sort(frame(0, 1)), []);
  following.hear({ what: "unfollowed", leader: LEADER, firstFrame: 1 });
  assert.deepEqual([following.isAway, following.leader], [true, 8n]);
  following.hear({ what: "followed", leader: 8n, firstFrame: 1 });
  for (const message of viewMessages(0, view(100))) {
    following.hear(message);
  }
  assert.deepEqual(seen(following.sort(frame(1, 2))), [[2, 100]]);
});

test("only the newest frames are kept", () => {
  const following = new Following();
  following.follow(LEADER);
  for (let number = 0; number < 100; number += 1) {
    following.sort(frame(number, number));
  }
  following.hear({ what: "unfollowed", leader: LEADER, firstFrame: 0 });
  assert.deepEqual(
    seen(following.sort()).map(([camera]) => camera),
    [96, 97, 98, 99],
  );
});
