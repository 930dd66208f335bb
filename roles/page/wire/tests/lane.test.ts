/** A lane by itself, with the test as connection, and the clock of the machine. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { encodeClose } from "../src/handshake.ts";
import { Lane, type LaneEnd, systemClock } from "../src/lane.ts";
import { encodeMessage, Kind } from "../src/messages.ts";
import { FakeClock, FakeConnection } from "./support.ts";

const format = { latest: 4, header: 0, item: 4 };

function laneOver(connection: FakeConnection): Lane {
  return new Lane("bulk lane", connection, { format, clock: new FakeClock() });
}

test("a lane ends once, by what came first", () => {
  const connection = new FakeConnection();
  const lane = laneOver(connection);
  const ends: LaneEnd[] = [];
  lane.onEnd = (end) => ends.push(end);
  const close = { code: 3, text: "no power" };
  connection.onBytes?.(encodeMessage(Kind.close, encodeClose(close), format));
  connection.onEnd?.("reset");
  assert.deepEqual(ends, [], "nobody listens yet");
  lane.listen(() => assert.fail("a close is no message for the listener"));
  assert.deepEqual(ends, [{ why: "closed", ...close }]);
});

test("an error of the listener itself is no violation, and the lane goes on", () => {
  const connection = new FakeConnection();
  const lane = laneOver(connection);
  const fault = new TypeError("a fault of the application");
  lane.listen(() => {
    throw fault;
  });
  const block = encodeMessage(Kind.block, Uint8Array.of(1), format);
  assert.throws(() => connection.onBytes?.(block), fault);
  assert.equal(lane.isOver, false);
  connection.onEnd?.("reset");
  assert(lane.isOver && connection.isClosed);
});

test("the clock of the machine counts milliseconds", () => {
  const [before, now, after] = [performance.now(), systemClock.now(), performance.now()];
  assert(before <= now && now <= after);
});
