/** Links carry data and end, with the test as listener. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { Writer } from "../src/bytes.ts";
import { LinkError } from "../src/errors.ts";
import { hashOf, loadHasher } from "../src/frames.ts";
import { decodeClose, encodeClose, LANES, type LaneName } from "../src/handshake.ts";
import { itemsOf } from "../src/items.ts";
import { Kind } from "../src/messages.ts";
import { acceptOf, encodeCommand, encodePoint, linked, opened, POINT, Robot, THEM } from "./robot.ts";
import { range } from "./support.ts";

const HERE = { x: 1, y: 2, z: 3 };
const POINTS = range(0, 3).map((x) => ({ x, y: 0.5, z: -1 }));
const STOP = encodeCommand({ command: "Stop" });
const hasher = await loadHasher();

/** The payload of the end of a frame of these points. */
function endOf(number: number, points: typeof POINTS): Uint8Array {
  const bytes = itemsOf(POINT).encode(points);
  return new Writer()
    .u32(number)
    .u32(points.length)
    .u64(hashOf(hasher.init().update(bytes)))
    .take();
}

/** Sends a frame of these points. */
function sayFrame(robot: Robot, number: number, points: typeof POINTS): void {
  robot.say("frames", Kind.begin, new Writer().u32(number).bytes(encodePoint(HERE)).take());
  for (const point of points) {
    robot.say("frames", Kind.batch, encodePoint(point));
  }
  robot.say("frames", Kind.end, endOf(number, points));
}

/** All that a reader still gets, and how the lane ends for it. */
async function readAll(arrivals: AsyncIterable<unknown>): Promise<unknown[]> {
  const all: unknown[] = [];
  try {
    for await (const arrival of arrivals) {
      all.push(arrival);
    }
    return [...all, "done"];
  } catch (error) {
    assert(error instanceof LinkError);
    return [...all, error.code];
  }
}

test("what is sent arrives on its lane, both ways, and is counted", async () => {
  const { robot, link } = await linked();
  link.latest.publish(HERE);
  link.messages.send({ command: "Play", sound: "bell" });
  link.bulk.send(Uint8Array.of(2, 3));
  const bell = encodeCommand({ command: "Play", sound: "bell" });
  assert.deepEqual(robot.heard("latest"), [{ kind: Kind.latestValue, payload: encodePoint(HERE) }]);
  assert.deepEqual(robot.heard("messages"), [{ kind: Kind.message, payload: bell }]);
  assert.deepEqual(robot.heard("bulk"), [{ kind: Kind.block, payload: Uint8Array.of(2, 3) }]);
  robot.say("latest", Kind.latestValue, encodePoint(HERE));
  robot.say("messages", Kind.message, STOP);
  robot.say("bulk", Kind.keepAlive);
  robot.say("bulk", Kind.block, Uint8Array.of(5));
  sayFrame(robot, 9, POINTS);
  assert.deepEqual(await link.latest.receive(), HERE);
  assert.deepEqual(await link.messages.receive(), { command: "Stop" });
  assert.deepEqual(await link.bulk.receive(), Uint8Array.of(5));
  assert.deepEqual(await link.frames.receive(), { number: 9, header: HERE, items: POINTS });
  const accept = 4 + acceptOf(THEM).length;
  const { latest, frames, messages, bulk } = link.bytes;
  const hello = latest.sent - 16;
  assert.equal(hello, 4 + 6 + 8 + 1 + 1 + accept - 4);
  assert.deepEqual(frames, { sent: hello, received: accept + 20 + 3 * 16 + 20 });
  assert.deepEqual(messages, { sent: hello + 4 + bell.length, received: accept + 5 });
  assert.deepEqual(bulk, { sent: hello + 6, received: accept + 4 + 5 });
});

test("an incomplete frame is not received", async () => {
  const { robot, link } = await linked();
  robot.say("frames", Kind.begin, new Writer().u32(1).bytes(encodePoint(HERE)).take());
  robot.say("frames", Kind.end, endOf(1, POINTS));
  sayFrame(robot, 2, POINTS);
  assert.equal((await link.frames.receive()).number, 2);
});

test("only the newest value is sent once there is room again", async () => {
  const { robot, link } = await linked();
  const value = (x: number) => ({ x, y: 0, z: 0 });
  const connection = robot.connection("latest");
  const sent = () =>
    robot.heard("latest").map(({ payload }) => new DataView(payload.buffer).getFloat32(0, true));
  connection.waiting = 4096;
  link.latest.publish(value(1));
  assert.deepEqual(sent(), [1], "a few KiB are no reason to wait");
  connection.waiting = 4097;
  const timers = robot.clock.waiting;
  for (const number of range(2, 6)) {
    link.latest.publish(value(number));
  }
  assert.equal(robot.clock.waiting, timers + 1, "they wait together");
  robot.clock.pass(100);
  assert.deepEqual(sent(), []);
  connection.waiting = 0;
  robot.clock.pass(4);
  assert.deepEqual(sent(), [5]);
  link.latest.publish(value(6));
  assert.deepEqual(sent(), [6]);
  connection.waiting = 4097;
  link.close();
  link.latest.publish(value(7));
  assert.equal(robot.clock.waiting, 0, "a link that is over waits for no room");
});

test("a lane that says nothing is kept alive each five seconds", async () => {
  const { robot, link } = await linked();
  const keptAlive = (lane: LaneName) => robot.heard(lane).map(({ kind }) => kind === Kind.keepAlive);
  robot.clock.pass(4_999);
  assert.deepEqual(LANES.map(keptAlive), [[], [], [], []]);
  link.messages.send({ command: "Stop" });
  robot.heard("messages");
  robot.clock.pass(1);
  assert.deepEqual(LANES.map(keptAlive), [[true], [true], [], [true]]);
  robot.clock.pass(4_998);
  assert.deepEqual(keptAlive("messages"), []);
  robot.clock.pass(1);
  assert.deepEqual(keptAlive("messages"), [true]);
});

test("the shorter idle timeout holds, and a keep-alive is sent four times in it", async () => {
  const robot = new Robot();
  const connecting = robot.connect();
  await opened(robot);
  robot.accept(400);
  const link = await connecting;
  robot.heard("bulk");
  robot.clock.pass(100);
  assert.deepEqual(robot.heard("bulk"), [{ kind: Kind.keepAlive, payload: new Uint8Array(0) }]);
  robot.clock.pass(299);
  assert.equal(link.isOver, false);
  robot.clock.pass(1);
  assert.match(JSON.stringify(await link.closed), /nothing came on the [a-z]+ lane for 0.4 s/);
});

test("a peer that is silent for twenty seconds on a lane is lost, and a keep-alive is enough", async () => {
  const { robot, link } = await linked();
  for (const _ of range(0, 3)) {
    robot.clock.pass(19_999);
    for (const lane of LANES) {
      robot.say(lane, Kind.keepAlive);
    }
  }
  robot.clock.pass(19_999);
  for (const lane of LANES.filter((lane) => lane !== "frames")) {
    robot.say(lane, Kind.keepAlive);
  }
  assert.equal(link.isOver, false);
  robot.clock.pass(1);
  assert.deepEqual(await link.closed, { why: "lost", text: "nothing came on the frames lane for 20 s" });
  assert(robot.areAllClosed);
  assert.equal(robot.clock.waiting, 0);
});

test("this side leaves with a close on each lane, and nothing is sent or read any more", async () => {
  const { robot, link } = await linked();
  robot.say("messages", Kind.message, STOP);
  robot.connection("latest").waiting = 4097;
  link.latest.publish(HERE);
  link.close(1, "it was interrupted");
  assert.equal(robot.clock.waiting, 0, "no value waits");
  for (const lane of LANES) {
    const [close, ...more] = robot.heard(lane);
    assert(close?.kind === Kind.close && more.length === 0);
    assert.deepEqual(decodeClose(close.payload), { code: 1, text: "it was interrupted" });
  }
  assert.deepEqual(await link.closed, { why: "left", code: 1, text: "it was interrupted" });
  assert(robot.areAllClosed && link.isOver);
  link.close(1, "again");
  robot.connection("latest").waiting = 0;
  link.latest.publish(HERE);
  const left = {
    code: "left",
    close: { why: "left", code: 1, text: "it was interrupted" },
    message: "this side has closed the link: it was interrupted",
  };
  await assert.rejects(link.messages.send({ command: "Stop" }), left);
  await assert.rejects(link.messages.receive(), left);
  await assert.rejects(link.frames.send({ header: HERE, items: POINTS }), left);
  await assert.rejects(link.frames.receive(), left);
  assert.deepEqual(await readAll(link.messages), ["done"]);
  robot.clock.pass(60_000);
  assert.deepEqual(
    LANES.map((lane) => robot.heard(lane)),
    [[], [], [], []],
  );
});

test("a peer that leaves is heard to the end on all lanes", async () => {
  const { robot, link } = await linked();
  const close = encodeClose({ code: 0, text: "the shift is over" });
  robot.say("latest", Kind.close, close);
  robot.say("messages", Kind.message, STOP);
  robot.say("messages", Kind.close, close);
  robot.connection("frames").onEnd?.("gone");
  assert.equal(link.isOver, false);
  robot.say("bulk", Kind.close, close);
  assert.deepEqual(await link.closed, { why: "closed", code: 0, text: "the shift is over" });
  assert.deepEqual(await readAll(link.messages), [{ command: "Stop" }, "done"]);
  await assert.rejects(link.bulk.receive(), {
    code: "closed",
    close: { why: "closed", code: 0, text: "the shift is over" },
    message: "the peer has closed the link: the shift is over",
  });
  assert.equal(robot.clock.waiting, 0);
});

test("a peer that leaves on one lane alone has left two seconds later", async () => {
  const { robot, link } = await linked();
  robot.say("bulk", Kind.close, encodeClose({ code: 5, text: "" }));
  robot.clock.pass(1_999);
  assert.equal(link.isOver, false);
  robot.clock.pass(1);
  assert.deepEqual(await link.closed, { why: "closed", code: 5, text: "" });
  assert(robot.areAllClosed);
});

test("a peer that breaks the protocol while it leaves is let go at once", async () => {
  const { robot, link } = await linked();
  robot.say("latest", Kind.close, encodeClose({ code: 0, text: "" }));
  robot.say("bulk", Kind.message);
  const text = "on the bulk lane: a message came, which does not belong there";
  assert.deepEqual(await link.closed, { why: "violation", text });
  assert.equal(robot.clock.waiting, 0);
});

test("a peer that breaks the protocol is let go at once", async () => {
  const cases: [(robot: Robot) => void, string][] = [
    [
      ({ connections }) => connections.get("bulk")?.onBytes?.(Uint8Array.of(0x40, 1, 0x40, 0)),
      "on the bulk lane: a block cannot have 16385 bytes, only 0 to 16384",
    ],
    [
      (robot) => robot.say("bulk", Kind.message),
      "on the bulk lane: a message came, which does not belong there",
    ],
    [
      (robot) => robot.say("latest", Kind.numberedValue, new Uint8Array(16)),
      "on the latest lane: a numbered value came, which does not belong there",
    ],
    [
      (robot) => robot.say("frames", Kind.batch, new Uint8Array(12)),
      "on the frames lane: items came outside of a frame",
    ],
    [
      (robot) => robot.say("messages", Kind.message, Uint8Array.of(2)),
      "on the messages lane: 2 is none of Stop, Play",
    ],
    [
      (robot) => robot.say("messages", Kind.message, Uint8Array.of(0, 0)),
      "on the messages lane: 1 bytes too many",
    ],
  ];
  for (const [happen, text] of cases) {
    const { robot, link } = await linked();
    happen(robot);
    assert.deepEqual(await link.closed, { why: "violation", text });
    assert(robot.areAllClosed && link.isOver, text);
    assert.deepEqual(await readAll(link.messages), ["violation"]);
  }
});

test("a lane that ends without a close is a lost peer, and what came before is read", async () => {
  const { robot, link } = await linked();
  robot.say("messages", Kind.message, STOP);
  robot.connection("messages").onEnd?.("reset");
  assert.deepEqual(await link.closed, { why: "lost", text: "the messages lane ended: reset" });
  link.close(1, "too late");
  assert.deepEqual(await readAll(link.messages), [{ command: "Stop" }, "lost"]);
});

test("a connection that ends as something is sent leaves no timer behind", async () => {
  const { robot, link } = await linked();
  const connection = robot.connection("bulk");
  connection.send = () => connection.onEnd?.("reset");
  robot.clock.pass(5_000);
  assert.deepEqual(await link.closed, { why: "lost", text: "the bulk lane ended: reset" });
  assert.equal(robot.clock.waiting, 0);
});

test("a frame has at most as many items as the caller says", async () => {
  const { robot, link } = await linked({ maxItems: ({ map }) => map - 5 });
  sayFrame(robot, 1, POINTS.slice(0, 2));
  sayFrame(robot, 2, POINTS);
  assert.deepEqual(await link.closed, {
    why: "violation",
    text: "on the frames lane: frame 2 has more than 2 items",
  });
  assert.equal((await link.frames.receive()).number, 1);
});
