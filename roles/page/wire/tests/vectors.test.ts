/** The worked examples of the wire of links, with the application `robot/1`, match encoder and decoder. */

import assert from "node:assert/strict";

import { Reader, WireError, Writer } from "../src/bytes.ts";
import { describeChannels } from "../src/channels.ts";
import { record, tagged, text, whole } from "../src/codec.ts";
import { number, struct } from "../src/fixed.ts";
import { FrameAssembler, loadHasher } from "../src/frames.ts";
import {
  decodeAccept,
  decodeChannelsHello,
  decodeHello,
  decodeVersionedAccept,
  encodeAccept,
  encodeChannelsHello,
  encodeHello,
  encodeVersionedAccept,
  type Hello,
} from "../src/handshake.ts";
import { typedItems } from "../src/items.ts";
import { Kind } from "../src/messages.ts";
import { defineProtocol, formatOf } from "../src/protocol.ts";
import { type Check, closed, onlyMessage, refused, same, testPage } from "./examples.ts";
import { endOf, examplesOf, range } from "./support.ts";

const hasher = await loadHasher();

const asIs = (payload: Uint8Array) => payload;
const greeted = (expected: Hello) => same(Kind.hello, expected, decodeHello, encodeHello);

const ROBOT = "transport/wire/WIRE.md";
const POSE = struct({ x: "f32", y: "f32", heading: "f32" });

const NAME = whole(text());

/** The robot's decoder: reads the first cell, and how many. */
const cells = {
  decode: (batch: Uint8Array) => {
    const reader = new Reader(batch);
    const first = reader.u32();
    return Uint32Array.from(range(first, first + reader.u16()));
  },
  complete: () => {},
};

const PROTOCOL = defineProtocol({
  name: "robot/1",
  hello: text(),
  latest: POSE,
  header: number("u64"),
  items: typedItems(Uint32Array),
  message: tagged("command", { stop: {}, "go to": { place: text() } }),
  decoder: () => cells,
  channels: {
    clock: { latest: number("u64") },
    "back lidar": { header: POSE, items: typedItems(Uint32Array) },
  },
});

const FORMAT = formatOf(PROTOCOL);

/** Checks the frame of these examples. */
function robotFrame(names: readonly string[], items: readonly number[]): void {
  const assembler = new FrameAssembler(hasher, PROTOCOL, 1000);
  const frames = names.map((name) => {
    const bytes = examplesOf(ROBOT).get(name);
    assert(bytes !== undefined);
    return assembler.take(onlyMessage(bytes, FORMAT));
  });
  assert.deepEqual(frames.at(-1), { number: 9, header: 1000n, items: Uint32Array.from(items) });
}

/** A part of a frame, with all examples of that frame and its items. */
function framed(kind: Kind, written: Uint8Array, names = ["begin", "batch", "end"], items = [1, 258]): Check {
  const check = () => {
    robotFrame(names, items);
    return written;
  };
  return { kind, check };
}

const HERE = { x: 1, y: 2, heading: -3 };
const pose = whole(POSE);
const numbered = whole(record({ number: number("u32"), pose: POSE }));
const message = whole(PROTOCOL.message);

const INTRODUCED = {
  versions: { highest: 5, lowest: 4 },
  application: "robot/1",
  session: 5n,
  lane: "latest",
  idleTimeout: 20_000,
  introduction: NAME.encode("arm"),
} as const;

testPage(ROBOT, FORMAT, {
  hello: greeted(INTRODUCED),
  "hello-4": greeted({ ...INTRODUCED, versions: { highest: 4, lowest: 4 } }),
  "hello-7": {
    kind: Kind.hello,
    check(payload) {
      assert.throws(
        () => decodeHello(payload),
        new WireError("the peer speaks versions 6 to 7 of the wire, this one versions 4 to 5"),
      );
      return undefined;
    },
  },
  accept: same(
    Kind.versionedAccept,
    { version: 5, idleTimeout: 20_000, introduction: NAME.encode("map") },
    decodeVersionedAccept,
    encodeVersionedAccept,
  ),
  "accept-4": same(
    Kind.accept,
    { idleTimeout: 20_000, introduction: NAME.encode("map") },
    decodeAccept,
    encodeAccept,
  ),
  refuse: refused({ reason: "not taken", code: 1, text: "full" }),
  close: closed({ code: 3, text: "no power" }),
  "keep-alive": same(Kind.keepAlive, new Uint8Array(0), asIs, asIs),
  "hello-channels": same(
    Kind.channelsHello,
    { ...INTRODUCED, lane: 1, channels: describeChannels(PROTOCOL.channels) },
    decodeChannelsHello,
    encodeChannelsHello,
  ),
  "latest-value": same(Kind.latestValue, HERE, pose.decode, pose.encode),
  "numbered-value": same(Kind.numberedValue, { number: 5, pose: HERE }, numbered.decode, numbered.encode),
  begin: framed(Kind.begin, new Writer().u32(9).u64(1000n).take()),
  batch: framed(Kind.batch, new Writer().u32(1).u32(258).take()),
  end: framed(Kind.end, endOf(9, [1, 258])),
  "empty-end": framed(Kind.end, endOf(9, []), ["begin", "empty-end"], []),
  "coded-batch": {
    kind: Kind.codedBatch,
    check(payload) {
      const assembler = new FrameAssembler(hasher, PROTOCOL, 1000);
      assembler.take({ kind: Kind.begin, payload: new Writer().u32(9).u64(1000n).take() });
      assembler.take({ kind: Kind.codedBatch, payload });
      const outcome = assembler.take({ kind: Kind.end, payload: endOf(9, range(100, 150)) });
      assert(outcome !== undefined);
      assert.deepEqual([...outcome.items], range(100, 150));
      return new Writer().u32(100).u16(50).take();
    },
  },
  message: same(Kind.message, { command: "go to", place: "dock" }, message.decode, message.encode),
  block: same(
    Kind.block,
    "map tile",
    (payload) => new TextDecoder().decode(payload),
    (text) => new TextEncoder().encode(text),
  ),
});
