/** Links are made, refused, given up and aborted, with the test as listener. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { WireError } from "../src/bytes.ts";
import { LinkError, type LinkErrorCode } from "../src/errors.ts";
import {
  CODE_NOT_TAKEN,
  decodeClose,
  decodeHello,
  encodeAccept,
  encodeRefuse,
  encodeVersionedAccept,
  LANES,
  type Refusal,
} from "../src/handshake.ts";
import { Kind } from "../src/messages.ts";
import { acceptOf, encodeCommand, encodeHelloOf, linked, opened, Robot, THEM, US } from "./robot.ts";
import { FakeConnection, fromHex, settled, toHex } from "./support.ts";

const errorOf = (promise: Promise<unknown>): Promise<unknown> =>
  promise.then(
    () => assert.fail("no error"),
    (error: unknown) => error,
  );

test("each lane says hello with the same session, and the link is there once all are accepted", async () => {
  const robot = new Robot();
  const link = robot.connect();
  await opened(robot);
  for (const lane of LANES) {
    const [hello, ...more] = robot.heard(lane);
    assert(hello !== undefined && more.length === 0);
    const expected = {
      versions: { highest: 5, lowest: 4 },
      application: "robot/1",
      session: 5n,
      lane,
      idleTimeout: 20_000,
      introduction: encodeHelloOf(US),
    };
    assert.deepEqual(decodeHello(hello.payload), expected);
  }
  let isThere = false;
  link.then(() => {
    isThere = true;
  });
  for (const lane of LANES) {
    await settled();
    assert.equal(isThere, false, `before the ${lane} lane`);
    robot.say(lane, Kind.versionedAccept, acceptOf(THEM));
  }
  assert.deepEqual((await link).peer, THEM);
});

test("a listener of version 4 is met once more, with its own hello", async () => {
  const robot = new Robot();
  const link = robot.connect();
  await opened(robot);
  const first = [...robot.connections.values()];
  robot.say("frames", Kind.refuse, fromHex("04 00 00 04 05"));
  while (robot.connections.size < LANES.length || first.includes(robot.connection("bulk"))) {
    await settled();
  }
  await settled();
  assert(first.every(({ isClosed }) => isClosed));
  for (const lane of LANES) {
    const [hello] = robot.heard(lane);
    assert(hello !== undefined);
    assert.deepEqual(decodeHello(hello.payload).versions, { highest: 4, lowest: 4 });
    assert.equal(toHex(hello.payload.subarray(4, 15)), "04 00 07 72 6f 62 6f 74 2f 31 05");
    robot.say(lane, Kind.accept, encodeAccept({ idleTimeout: 20_000, introduction: encodeHelloOf(THEM) }));
  }
  assert.deepEqual((await link).peer, THEM);
});

test("without a version in common there is one attempt, and both ranges are named", async () => {
  const robot = new Robot();
  const link = robot.connect();
  await opened(robot);
  robot.say("frames", Kind.refuse, fromHex("06 00 00 07 06 05 04"));
  const error = await errorOf(link);
  assert(error instanceof LinkError);
  assert.match(error.message, /the listener speaks versions 6 to 7 of the wire, this side versions 4 to 5/);
});

test("what comes before the other lanes are accepted is not lost, and a lane's end neither", async () => {
  const robot = new Robot();
  const connecting = robot.connect();
  await opened(robot);
  robot.say("messages", Kind.versionedAccept, acceptOf(THEM));
  robot.say("messages", Kind.message, encodeCommand({ command: "Stop" }));
  robot.connection("messages").onEnd?.("reset");
  for (const lane of LANES.filter((lane) => lane !== "messages")) {
    robot.say(lane, Kind.versionedAccept, acceptOf(THEM));
  }
  const link = await connecting;
  assert.deepEqual(await link.messages.receive(), { command: "Stop" });
  assert.deepEqual(await link.closed, { why: "lost", text: "the messages lane ended: reset" });
});

test("a refusal says why, and all lanes are given up", async () => {
  const robot = new Robot();
  const link = robot.connect();
  await opened(robot);
  const refusal: Refusal = { reason: "busy" };
  robot.say("latest", Kind.versionedAccept, acceptOf(THEM));
  robot.say("bulk", Kind.refuse, encodeRefuse(refusal));
  const error = await errorOf(link);
  assert(error instanceof LinkError);
  assert.deepEqual([error.code, error.refusal, robot.areAllClosed], ["refused", refusal, true]);
  assert.equal("cause" in error, false, "no other error is behind it");
  assert.equal(robot.clock.waiting, 0, "no timer is left");
});

test("a listener that does not answer, answers otherwise, or is gone makes no link", async () => {
  const accept = (robot: Robot, introduction: Uint8Array) => {
    for (const lane of LANES) {
      const own = lane === "bulk" ? introduction : encodeHelloOf(THEM);
      const answer = encodeVersionedAccept({ version: 5, idleTimeout: 20_000, introduction: own });
      robot.say(lane, Kind.versionedAccept, answer);
    }
  };
  const cases: [LinkErrorCode, (robot: Robot) => void, RegExp][] = [
    ["timeout", (robot) => robot.clock.pass(20_000), /did not answer in time/],
    ["violation", (robot) => robot.say("bulk", Kind.block), /block came instead of an answer/],
    ["lost", (robot) => robot.connection("frames").onEnd?.("reset"), /frames lane ended: reset/],
    ["violation", (robot) => accept(robot, encodeHelloOf(US)), /call themselves differently/],
    ["violation", (robot) => accept(robot, encodeHelloOf(THEM).subarray(1)), /themselves differently/],
    ["violation", (robot) => accept(robot, encodeHelloOf(THEM).subarray(0, -1)), /themselves differently/],
  ];
  for (const [code, happen, text] of cases) {
    const robot = new Robot();
    const link = robot.connect();
    await opened(robot);
    happen(robot);
    const isIt = (error: unknown) =>
      error instanceof LinkError && error.code === code && text.test(error.message);
    await assert.rejects(link, isIt, String(text));
    assert(robot.areAllClosed, String(text));
    assert.equal(robot.clock.waiting, 0, String(text));
  }
});

test("a connection that opens after another failed is closed", async () => {
  const robot = new Robot();
  let openLate = (_: FakeConnection) => {};
  const open = robot.open.bind(robot);
  const cause = new Error("no route");
  robot.open = (lane) => {
    if (lane === "frames") {
      return Promise.reject(cause);
    }
    return lane === "bulk" ? new Promise((resolve) => (openLate = resolve)) : open(lane);
  };
  const error = await errorOf(robot.connect());
  assert(error instanceof LinkError);
  assert.deepEqual([error.code, error.message, error.cause], ["unreachable", "no route", cause]);
  const late = new FakeConnection();
  openLate(late);
  await settled();
  assert(robot.areAllClosed && late.isClosed && late.sent.length === 0);
});

test("a listener that is not taken is told so", async () => {
  const robot = new Robot();
  const link = robot.connect({ admit: ({ name }) => (name === "robot" ? "the maps differ" : undefined) });
  await opened(robot);
  robot.accept();
  await assert.rejects(link, new LinkError("rejected", "the maps differ"));
  for (const lane of LANES) {
    const [close] = robot.heard(lane);
    const expected = { code: CODE_NOT_TAKEN, text: "the maps differ" };
    assert.deepEqual(close && decodeClose(close.payload), expected);
  }
  assert(robot.areAllClosed);
});

test("an error of the caller's own judgement is thrown as it is, and the listener is told", async () => {
  const fail = (error: Error) => () => {
    throw error;
  };
  const error = new WireError("of the caller");
  for (const judged of [{ admit: fail(error) }, { maxItems: fail(error) }]) {
    const robot = new Robot();
    const link = robot.connect(judged);
    await opened(robot);
    robot.accept();
    assert.equal(await errorOf(link), error);
    const [close] = robot.heard("messages");
    const expected = { code: CODE_NOT_TAKEN, text: "it failed while it made the link" };
    assert.deepEqual(close && decodeClose(close.payload), expected);
    assert.deepEqual([robot.areAllClosed, robot.clock.waiting], [true, 0]);
  }
});

test("a listener whose hello cannot be read is not taken", async () => {
  const robot = new Robot();
  const link = robot.connect();
  await opened(robot);
  for (const lane of LANES) {
    robot.say(lane, Kind.accept, encodeAccept({ idleTimeout: 1, introduction: Uint8Array.of(9) }));
  }
  const error = await errorOf(link);
  assert(error instanceof LinkError && error.cause instanceof Error);
  assert.match(error.message, /the listener's hello cannot be read: cut short/);
  assert.equal(error.code, "violation");
});

test("an attempt that is aborted ends with the signal's reason, and leaves nothing behind", async () => {
  const robot = new Robot();
  const giveUp = new AbortController();
  const link = robot.connect({ signal: giveUp.signal });
  await opened(robot);
  const reason = new Error("nobody waits any more");
  giveUp.abort(reason);
  assert.equal(await errorOf(link), reason);
  assert(robot.areAllClosed);
  assert.equal(robot.clock.waiting, 0);
  const later = new Robot();
  assert.equal(await errorOf(later.connect({ signal: giveUp.signal })), reason);
  assert.equal(later.connections.size, 0, "no connection is opened");
});

test("a hello that does not fit is an error of the caller", async () => {
  const hello = { name: "x".repeat(200), map: 7 };
  await assert.rejects(new Robot().connect({ hello }), /a hello of 203 bytes: it has at most 200/);
  const { link } = await linked({ hello: { ...hello, name: "x".repeat(197) } });
  assert.deepEqual(link.peer, THEM);
});
