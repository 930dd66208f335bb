import assert from "node:assert/strict";
import { test } from "node:test";
import { Dealing } from "../src/display/dealing.ts";
import { Introduction } from "../src/display/introduction.ts";
import type { RoleMessage } from "../src/proto/messages.ts";

test("a newer camera goes to who is free, and else takes the place of one that waits", () => {
  const dealing = new Dealing(2, 10);
  assert.deepEqual(dealing.deal(), { culler: 0, frame: 11 });
  assert.deepEqual(dealing.deal(), { culler: 1, frame: 12 });
  assert.deepEqual(dealing.deal(), { culler: 0, frame: 13 }, "it has been busy longest");
  assert.deepEqual(dealing.deal(), { culler: 0, frame: 14 }, "in the place of 13");
  dealing.came(1, 12);
  assert.deepEqual(dealing.deal(), { culler: 1, frame: 15 }, "it is free");
  dealing.came(0, 11);
  dealing.came(0, 14);
  dealing.came(1, 15);
  assert.deepEqual(dealing.deal(), { culler: 0, frame: 16 }, "it has waited longest");
});

test("a lone culler always gets the newest camera", () => {
  const dealing = new Dealing(1, 0);
  const dealt = [1, 2, 3].map(() => dealing.deal());
  assert.deepEqual(
    dealt,
    [1, 2, 3].map((frame) => ({ culler: 0, frame })),
  );
  dealing.came(0, 3);
  assert.deepEqual(dealing.deal(), { culler: 0, frame: 4 });
});

test("in turn no frame is left out, and a camera waits until its culler is free", () => {
  const dealing = new Dealing(2, 3);
  dealing.isInTurn = true;
  assert.deepEqual(dealing.deal(), { culler: 0, frame: 4 });
  assert.deepEqual(dealing.deal(), { culler: 1, frame: 5 });
  assert.equal(dealing.deal(), undefined, "6 in the cell of 4 would take its place there");
  dealing.came(1, 5);
  assert.equal(dealing.deal(), undefined, "6 is due to the other one");
  dealing.came(0, 4);
  assert.deepEqual(dealing.deal(), { culler: 0, frame: 6 });
  assert.deepEqual(dealing.deal(), { culler: 1, frame: 7 });
  dealing.came(0, 6);
  dealing.isHeld = true;
  assert.equal(dealing.deal(), undefined);
});

/** An introduction with its messages and its outcome. */
function introduced() {
  const said: [number, RoleMessage][] = [];
  const outcomes: boolean[] = [];
  const introduction = new Introduction(
    "inproc://here",
    (culler, message) => said.push([culler, message]),
    () => 21,
    ({ isSwitched }) => outcomes.push(isSwitched),
  );
  const [[, meet] = []] = said;
  const key = meet?.what === "meet" ? meet.key : 0n;
  return { introduction, said, outcomes, key };
}

test("two cullers meet, hear from which frame on they take turns, and say that they do", () => {
  const { introduction, said, outcomes, key } = introduced();
  assert.deepEqual(said, [[1, { what: "meet", key, endpoint: undefined }]]);
  introduction.hear(1, { what: "waits", key: key ^ 1n });
  introduction.hear(1, { what: "waits", key });
  introduction.hear(1, { what: "waits", key });
  assert.deepEqual(said.slice(1), [[0, { what: "meet", key, endpoint: "inproc://here" }]]);
  said.length = 0;
  introduction.hear(0, { what: "met", key: key ^ 1n });
  introduction.hear(0, { what: "met", key });
  introduction.hear(0, { what: "met", key });
  assert.deepEqual(said, [], "the other one has not met");
  introduction.hear(1, { what: "met", key });
  const change = { what: "switch", key, firstFrame: 21 } as const;
  assert.deepEqual(said, [
    [0, change],
    [1, change],
  ]);
  introduction.hear(1, { what: "switched", key });
  assert.deepEqual(outcomes, []);
  introduction.hear(0, { what: "switched", key });
  introduction.hear(0, { what: "unmet", key });
  assert.deepEqual(outcomes, [true]);
});

test("cullers that do not meet, or not in time, go on by themselves", (context) => {
  let timeUp = () => {};
  // Without mocked timers: their use differs between Node 18 and 20.
  context.mock.method(globalThis, "setTimeout", (call: () => void, after: number) => {
    assert.equal(after, 12_000);
    timeUp = call;
  });
  for (const [name, fail] of [
    ["unmet", (it: Introduction, key: bigint) => it.hear(1, { what: "unmet", key })],
    ["late", () => timeUp()],
  ] as const) {
    const { introduction, said, outcomes, key } = introduced();
    introduction.hear(1, { what: "waits", key });
    introduction.hear(0, { what: "met", key });
    fail(introduction, key);
    assert.deepEqual(
      [outcomes, said.slice(2).map(([culler, { what }]) => [culler, what])],
      [
        [false],
        [
          [0, "part"],
          [1, "part"],
        ],
      ],
      name,
    );
    introduction.hear(1, { what: "met", key });
    assert.deepEqual(outcomes, [false]);
  }
});
