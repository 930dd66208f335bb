/** Channels of a link, with the test as listener. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { Writer } from "../src/bytes.ts";
import { type Channels, channelFormat, describeChannels } from "../src/channels.ts";
import { connect } from "../src/connect.ts";
import { nothing, number } from "../src/fixed.ts";
import { hashOf, loadHasher } from "../src/frames.ts";
import {
  CODE_NOT_TAKEN,
  decodeChannelsHello,
  decodeClose,
  encodeRefuse,
  LANES,
  type LaneId,
} from "../src/handshake.ts";
import { typedItems } from "../src/items.ts";
import { Kind } from "../src/messages.ts";
import { defineProtocol, formatOf } from "../src/protocol.ts";
import { acceptOf, encodeHelloOf, POINT, ROBOT, Robot, THEM, US } from "./robot.ts";
import { endOf, range, settled } from "./support.ts";

const ROVER = defineProtocol({
  ...ROBOT,
  name: "rover/1",
  channels: {
    clock: { latest: number("u64") },
    "back lidar": { header: POINT, items: typedItems(Uint16Array) },
    alive: { latest: number("u8") },
  },
});

const FORMATS = Object.values(ROVER.channels).map(channelFormat);
const HERE = { x: 1, y: 2, z: 3 };
const hasher = await loadHasher();

class Rover extends Robot {
  constructor() {
    super((lane) => (typeof lane === "number" ? FORMATS[lane] : undefined) ?? formatOf(ROVER));
  }

  async opening(options: { admit?: () => string } = {}) {
    const fakes = { session: 5n, clock: this.clock, open: (_: string, lane: LaneId) => this.open(lane) };
    const link = connect("ws://two:7400", ROVER, { hello: US, keepFrames: 2, ...fakes, ...options });
    while (this.connections.size < LANES.length + FORMATS.length) {
      await settled();
    }
    await settled();
    return { link };
  }

  async linked() {
    const { link } = await this.opening();
    this.accept();
    return link;
  }

  sayScan(frame: number, items: readonly number[]): void {
    const bytes = new Uint8Array(Uint16Array.from(items).buffer);
    const begin = new Writer().u32(frame).f32(HERE.x).f32(HERE.y).f32(HERE.z).take();
    this.say(1, Kind.begin, begin);
    this.say(1, Kind.batch, bytes);
    const end = new Writer()
      .u32(frame)
      .u32(items.length)
      .u64(hashOf(hasher.init().update(bytes)));
    this.say(1, Kind.end, end.take());
  }
}

test("each lane and channel says hello with all channels, and all must be accepted", async () => {
  const rover = new Rover();
  const { link } = await rover.opening();
  const all = [...LANES, 0, 1, 2];
  assert.deepEqual([...rover.connections.keys()], all);
  let isThere = false;
  link.then(() => {
    isThere = true;
  });
  for (const lane of all) {
    const [hello, ...more] = rover.heard(lane);
    assert(hello?.kind === Kind.channelsHello && more.length === 0);
    assert.deepEqual(decodeChannelsHello(hello.payload), {
      versions: { highest: 5, lowest: 4 },
      application: "rover/1",
      session: 5n,
      lane,
      idleTimeout: 20_000,
      channels: describeChannels(ROVER.channels),
      introduction: encodeHelloOf(US),
    });
    await settled();
    assert.equal(isThere, false, `before ${lane}`);
    rover.say(lane, Kind.versionedAccept, acceptOf(THEM));
  }
  assert.deepEqual((await link).peer, THEM);
});

test("values and frames of channels arrive, both ways, and are counted", async () => {
  const rover = new Rover();
  const link = await rover.linked();
  const { clock, alive, "back lidar": lidar } = link.channels;
  clock.publish(7n);
  assert.deepEqual(rover.heard(0), [{ kind: Kind.latestValue, payload: new Writer().u64(7n).take() }]);
  assert.equal(await lidar.send({ number: 4, header: HERE, items: Uint16Array.of(1, 2) }), 4);
  const kinds = rover.heard(1).map(({ kind }) => kind);
  assert.deepEqual(kinds, [Kind.begin, Kind.batch, Kind.end]);
  for (const value of [1n, 2n]) {
    rover.say(0, Kind.latestValue, new Writer().u64(value).take());
  }
  rover.say(2, Kind.latestValue, Uint8Array.of(9));
  assert.deepEqual([await clock.receive(), clock.skipped, await alive.receive()], [2n, 1, 9]);
  for (const frame of [1, 2, 3]) {
    rover.sayScan(frame, [frame, 500]);
  }
  const scan = { header: HERE, items: Uint16Array.of(2, 500) };
  assert.deepEqual(await lidar.receive(), { number: 2, ...scan });
  assert.equal(lidar.skipped, 1);
  const accept = 4 + acceptOf(THEM).length;
  const { alive: bytes } = link.channelBytes;
  assert.deepEqual(bytes, { sent: link.channelBytes.clock.sent - 12, received: accept + 5 });
});

test("a channel that breaks the protocol, ends or is not read ends the link, and says which", async () => {
  const cases: [(rover: Rover) => void, object][] = [
    [
      (rover) => rover.say(0, Kind.begin, new Uint8Array(4)),
      { why: "violation", text: "on the channel clock: a begin came, which does not belong there" },
    ],
    [
      (rover) => rover.connection(2).onBytes?.(Uint8Array.of(Kind.latestValue, 8, 0, 0)),
      { why: "violation", text: "on the channel alive: a latest value cannot have 8 bytes, only 1 to 1" },
    ],
    [
      (rover) => {
        rover.say(1, Kind.begin, new Uint8Array(16));
        rover.say(1, Kind.codedBatch, Uint8Array.of(1));
      },
      { why: "violation", text: "on the channel back lidar: a batch came coded, and was not asked for so" },
    ],
    [
      (rover) => rover.connection(1).onEnd?.("reset"),
      { why: "lost", text: "the channel back lidar ended: reset" },
    ],
  ];
  for (const [happen, end] of cases) {
    const rover = new Rover();
    const link = await rover.linked();
    happen(rover);
    assert.deepEqual(await link.closed, end);
    assert(rover.areAllClosed);
    assert.equal(rover.clock.waiting, 0);
    await assert.rejects(link.channels.clock.receive());
  }
});

test("a channel with a decoder takes coded batches", async () => {
  const decoder = () => ({
    decode: (batch: Uint8Array) => Uint32Array.from(batch, (byte) => byte + 1),
    complete: () => {},
  });
  const coded = { header: nothing, items: typedItems(Uint32Array), decoder };
  const protocol = defineProtocol({ ...ROBOT, channels: { coded } });
  const format = channelFormat(coded);
  const robot = new Robot((lane) => (lane === 0 ? format : formatOf(ROBOT)));
  const fakes = { clock: robot.clock, open: (_: string, lane: LaneId) => robot.open(lane) };
  const connecting = connect("ws://two:7400", protocol, { hello: US, ...fakes });
  while (robot.connections.size < 5) {
    await settled();
  }
  await settled();
  robot.accept();
  robot.say(0, Kind.begin, new Writer().u32(7).take());
  robot.say(0, Kind.codedBatch, Uint8Array.of(1, 2));
  robot.say(0, Kind.end, endOf(7, [2, 3]));
  const { items } = await (await connecting).channels.coded.receive();
  assert.deepEqual(items, Uint32Array.of(2, 3));
});

test("a close is said and heard on channels", async () => {
  const rover = new Rover();
  const link = await rover.linked();
  link.close(3, "no power");
  for (const lane of [...LANES, 0, 1, 2]) {
    const [close] = rover.heard(lane);
    assert.deepEqual(close && decodeClose(close.payload), { code: 3, text: "no power" });
  }
  assert(rover.areAllClosed);
});

test("a listener that is not taken is told so on channels", async () => {
  const rover = new Rover();
  const { link } = await rover.opening({ admit: () => "the maps differ" });
  rover.accept();
  await assert.rejects(link, { code: "rejected" });
  const [close] = rover.heard(1);
  assert.equal(close && decodeClose(close.payload).code, CODE_NOT_TAKEN);
});

test("channels that differ are refused by name", async () => {
  const rover = new Rover();
  const { link } = await rover.opening();
  const [connector] = describeChannels(ROVER.channels);
  const listener = { name: "front", sizes: { kind: "frames", header: 0, item: 4 } } as const;
  rover.say(2, Kind.refuse, encodeRefuse({ reason: "channels", number: 0, listener, connector }));
  await assert.rejects(link, {
    code: "refused",
    message:
      "channel 0 of the listener is `front` of frames with headers of 0 and items of 4 bytes, that of this " +
      "side `clock` of values of 8 bytes: install the same release on both",
  });
  assert(rover.areAllClosed);
});

test("channels that the wire does not allow are errors of the caller", () => {
  const latest = number("u8");
  const define = (channels: Channels) => () => defineProtocol({ ...ROBOT, channels });
  const many = (count: number) =>
    Object.fromEntries(range(0, count).map((at) => [`${at}c${at}`, { latest }]));
  const bad: [Channels, RegExp][] = [
    [many(17), /17 channels: it may have 16/],
    [{ "": { latest } }, /0 bytes: it must have 1 to 32/],
    [{ 5: { latest } }, /does not keep the order/],
    [{ 12: { latest } }, /does not keep the order/],
    [{ wide: { latest: { ...latest, size: 1025 } } }, /a value of the channel wide has 1025 bytes/],
    [{ none: { header: latest, items: { ...typedItems(Uint8Array), size: 0 } } }, /item of the channel none/],
  ];
  for (const [channels, error] of bad) {
    assert.throws(define(channels), error);
  }
  assert.equal(Object.keys(define(many(16))().channels).length, 16);
});
