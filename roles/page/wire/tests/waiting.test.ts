/** Readers and senders that wait, are slow, or give up. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { Reader, Writer } from "../src/bytes.ts";
import { hashOf, loadHasher } from "../src/frames.ts";
import { itemsOf } from "../src/items.ts";
import { Kind } from "../src/messages.ts";
import { encodeCommand, encodePoint, linked, POINT, type Robot } from "./robot.ts";
import { range, settled } from "./support.ts";

const HERE = { x: 1, y: 2, z: 3 };
const STOP = { command: "Stop" } as const;

const sayStop = (robot: Robot) => robot.say("messages", Kind.message, encodeCommand(STOP));

const hasher = await loadHasher();

/** Sends a frame of one point. */
function sayFrame(robot: Robot, number: number): void {
  robot.say("frames", Kind.begin, new Writer().u32(number).bytes(encodePoint(HERE)).take());
  robot.say("frames", Kind.batch, encodePoint(HERE));
  const hash = hashOf(hasher.init().update(encodePoint(HERE)));
  robot.say("frames", Kind.end, new Writer().u32(number).u32(1).u64(hash).take());
}

async function isPending(promise: Promise<unknown>): Promise<boolean> {
  let isOver = false;
  const over = () => {
    isOver = true;
  };
  promise.then(over, over);
  await settled();
  return !isOver;
}

test("readers that wait are served in order", async () => {
  const { robot, link } = await linked();
  const [first, second] = [link.bulk.receive(), link.bulk.receive()];
  robot.say("bulk", Kind.block, Uint8Array.of(1));
  robot.say("bulk", Kind.block, Uint8Array.of(2));
  assert.deepEqual(await Promise.all([first, second]), [Uint8Array.of(1), Uint8Array.of(2)]);
});

test("readers that wait when the link ends are told why", async () => {
  const { robot, link } = await linked();
  const reads = [link.bulk.receive(), link.bulk.receive(), link.frames.receive()];
  robot.connection("latest").onEnd?.("reset");
  const lost = { code: "lost", message: "the latest lane ended: reset" };
  await Promise.all(reads.map((read) => assert.rejects(read, lost)));
});

test("a reader that gives up loses nothing", async () => {
  const { robot, link } = await linked();
  const giveUp = new AbortController();
  const read = link.messages.receive({ signal: giveUp.signal });
  giveUp.abort(new Error("no time"));
  await assert.rejects(read, new Error("no time"));
  sayStop(robot);
  await assert.rejects(link.messages.receive({ signal: giveUp.signal }), new Error("no time"));
  assert.deepEqual(await link.messages.receive(), STOP);
});

test("a deadline is a signal", async () => {
  const { link } = await linked();
  // Node does not stay for such a signal.
  const stay = setTimeout(() => {}, 10_000);
  await assert.rejects(link.latest.receive({ signal: AbortSignal.timeout(1) }), { name: "TimeoutError" });
  clearTimeout(stay);
});

test("a loop may be left and begun again", async () => {
  const { robot, link } = await linked();
  for (const byte of range(0, 3)) {
    robot.say("bulk", Kind.block, Uint8Array.of(byte));
  }
  const read: (number | undefined)[] = [];
  for await (const [byte] of link.bulk) {
    read.push(byte);
    break;
  }
  for await (const [byte] of link.bulk) {
    read.push(byte);
    if (byte === 2) {
      break;
    }
  }
  assert.deepEqual(read, [0, 1, 2]);
});

test("a slow reader of values gets the newest, and of frames as many as it keeps", async () => {
  const { robot, link } = await linked({ keepFrames: 2 });
  for (const number of range(0, 5)) {
    robot.say("latest", Kind.latestValue, encodePoint({ ...HERE, x: number }));
    sayFrame(robot, number);
  }
  assert.deepEqual([(await link.latest.receive()).x, link.latest.skipped], [4, 4]);
  const frames = [await link.frames.receive(), await link.frames.receive()];
  assert.deepEqual([frames.map(({ number }) => number), link.frames.skipped], [[3, 4], 3]);
  assert(await isPending(link.latest.receive()));
});

test("a link whose reader leaves too much unread ends, and says so", async () => {
  const { robot, link } = await linked({ maxUnread: 2 });
  sayStop(robot);
  sayStop(robot);
  assert.deepEqual(await link.messages.receive(), STOP);
  sayStop(robot);
  assert.equal(link.isOver, false);
  sayStop(robot);
  const text = "more than 2 bytes wait for a reader on the messages lane";
  assert.deepEqual(await link.closed, { why: "overflow", text });
  assert(robot.areAllClosed);
});

test("an unread frame counts with the bytes of all its messages", async () => {
  const { robot, link } = await linked({ maxUnread: 2 * (16 + 12 + 16) });
  sayFrame(robot, 0);
  sayFrame(robot, 1);
  assert.equal(link.isOver, false);
  sayFrame(robot, 2);
  const text = "more than 88 bytes wait for a reader on the frames lane";
  assert.deepEqual(await link.closed, { why: "overflow", text });
});

test("a sender waits until its lane has room", async () => {
  const { robot, link } = await linked();
  const connection = robot.connection("bulk");
  connection.waiting = 262_144;
  await link.bulk.send(Uint8Array.of(1));
  connection.waiting = 262_145;
  const sent = link.bulk.send(Uint8Array.of(2));
  assert.equal(robot.heard("bulk").length, 2, "it is queued at once");
  robot.clock.pass(100);
  assert(await isPending(sent));
  const giveUp = new AbortController();
  const given = link.bulk.send(Uint8Array.of(3), { signal: giveUp.signal });
  giveUp.abort(new Error("no time"));
  await assert.rejects(given, new Error("no time"));
  connection.waiting = 0;
  robot.clock.pass(4);
  await sent;
  connection.waiting = 262_145;
  const never = link.bulk.send(Uint8Array.of(4));
  link.close();
  await assert.rejects(never, { code: "left" });
  assert.equal(robot.clock.waiting, 0);
});

test("a message that is too large is an error of the caller", async () => {
  const { link } = await linked();
  await assert.rejects(link.bulk.send(new Uint8Array(16_385)), RangeError);
  assert.equal(link.isOver, false);
});

const POINTS = range(0, 12_000).map((x) => ({ x, y: 0, z: 0 }));

test("frames are sent one after the other, in batches, with their count and hash", async () => {
  const { robot, link } = await linked();
  const numbers = [
    link.frames.send({ header: HERE, items: POINTS }),
    link.frames.send({ number: 7, header: HERE, items: [] }),
    link.frames.send({ header: HERE, items: POINTS.slice(0, 1) }),
  ];
  assert.deepEqual(await Promise.all(numbers), [0, 7, 8]);
  const heard = robot.heard("frames");
  const { begin, batch, end } = Kind;
  const kinds = [begin, batch, batch, batch, end, begin, end, begin, batch, end];
  assert.deepEqual(
    heard.map(({ kind }) => kind),
    kinds,
  );
  assert.deepEqual(heard[0]?.payload, new Writer().u32(0).bytes(encodePoint(HERE)).take());
  assert(heard.every(({ payload }) => payload.length <= 65_536));
  const bytes = itemsOf(POINT).encode(POINTS);
  const expected = new Writer()
    .u32(0)
    .u32(12_000)
    .u64(hashOf(hasher.init().update(bytes)))
    .take();
  assert.deepEqual(heard[4]?.payload, expected);
  await assert.rejects(link.frames.send({ number: 8, header: HERE, items: [] }), /the next number is 9/);
  assert.equal(await link.frames.send({ number: 0xffff_ffff, header: HERE, items: [] }), 0xffff_ffff);
  await assert.rejects(link.frames.send({ header: HERE, items: [] }), /frame 4294967296 cannot be sent/);
});

test("a frame that is aborted on its way ends, and the peer knows that items are missing", async () => {
  const { robot, link } = await linked();
  const giveUp = new AbortController();
  robot.connection("frames").waiting = 262_145;
  const sent = link.frames.send({ header: HERE, items: POINTS }, { signal: giveUp.signal });
  await settled();
  giveUp.abort(new Error("no time"));
  robot.connection("frames").waiting = 0;
  robot.clock.pass(4);
  await assert.rejects(sent, new Error("no time"));
  const [begin, end, ...more] = robot.heard("frames");
  assert.deepEqual([begin?.kind, end?.kind, more], [Kind.begin, Kind.end, []]);
  const reader = new Reader(end?.payload ?? new Uint8Array(0));
  assert.deepEqual([reader.u32(), reader.u32()], [0, 12_000]);
  assert.equal(await link.frames.send({ header: HERE, items: [] }), 1);
});

test("a frame that is aborted after its last batch is complete", async () => {
  const { robot, link } = await linked();
  const giveUp = new AbortController();
  const connection = robot.connection("frames");
  connection.waiting = 262_145;
  // As many points as a batch takes.
  const items = POINTS.slice(0, 5_461);
  const sent = link.frames.send({ header: HERE, items }, { signal: giveUp.signal });
  await settled();
  connection.waiting = 0;
  robot.clock.pass(4);
  connection.waiting = 262_145;
  await settled();
  giveUp.abort();
  connection.waiting = 0;
  robot.clock.pass(4);
  assert.equal(await sent, 0);
  const kinds = robot.heard("frames").map(({ kind }) => kind);
  assert.deepEqual(kinds, [Kind.begin, Kind.batch, Kind.end]);
});
