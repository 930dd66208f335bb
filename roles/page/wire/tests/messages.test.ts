/** Messages are found in a stream however it is split, and headers are checked at once. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { WireError, Writer } from "../src/bytes.ts";
import {
  decodeChannelsHello,
  decodeClose,
  decodeHello,
  decodeRefuse,
  decodeVersionedAccept,
  describeRefusal,
  encodeChannelsHello,
  encodeClose,
  encodeHello,
  encodeRefuse,
  encodeVersionedAccept,
  type Refusal,
} from "../src/handshake.ts";
import { encodeMessage, Kind, lengthsOf, type Message, MessageStream } from "../src/messages.ts";
import { concat, fromHex, randomOf, takeAll } from "./support.ts";

const format = { latest: 72, header: 72, item: 4 };

const messages: Message[] = [
  { kind: Kind.accept, payload: Uint8Array.from([1, 2, 3]) },
  { kind: Kind.keepAlive, payload: new Uint8Array(0) },
  { kind: Kind.message, payload: new Uint8Array(0) },
  { kind: Kind.latestValue, payload: new Uint8Array(72).fill(7) },
  { kind: Kind.block, payload: new Uint8Array(300).fill(9) },
  { kind: Kind.close, payload: Uint8Array.from([0, 0]) },
];

const stream = concat(...messages.map(({ kind, payload }) => encodeMessage(kind, payload, format)));

test("messages are the same wherever their bytes are split", () => {
  for (let split = 0; split <= stream.length; split += 1) {
    const reader = new MessageStream(format);
    reader.push(stream.subarray(0, split));
    const before = takeAll(reader);
    reader.push(stream.subarray(split));
    assert.deepEqual([...before, ...takeAll(reader)], messages, `split at ${split}`);
    assert.equal(reader.pending, 0);
  }
});

test("messages are the same byte by byte and in random pieces", () => {
  const random = randomOf(1);
  const long = concat(stream, stream, stream);
  for (const largest of [1, 2, 5, 400]) {
    const reader = new MessageStream(format);
    const taken: Message[] = [];
    for (let at = 0; at < long.length; ) {
      const end = Math.min(long.length, at + 1 + random(largest));
      reader.push(long.subarray(at, end));
      taken.push(...takeAll(reader));
      at = end;
    }
    assert.deepEqual(taken, [...messages, ...messages, ...messages]);
  }
});

test("a payload stays what it was when more is pushed", () => {
  const reader = new MessageStream(format);
  reader.push(stream.subarray(0, 7));
  const first = reader.take();
  reader.push(new Uint8Array(7).fill(0xee));
  assert.deepEqual(first?.payload, Uint8Array.from([1, 2, 3]));
});

test("the lengths of each kind are those of the page, to the byte", () => {
  const lengths: [Kind, number, number][] = [
    [Kind.hello, 2, 258],
    [Kind.accept, 1, 205],
    [Kind.refuse, 2, 512],
    [Kind.close, 1, 256],
    [Kind.keepAlive, 0, 0],
    [Kind.channelsHello, 2, 899],
    [Kind.versionedAccept, 3, 207],
    [Kind.latestValue, 72, 72],
    [Kind.numberedValue, 76, 76],
    [Kind.begin, 76, 76],
    [Kind.batch, 4, 65_536],
    [Kind.end, 16, 16],
    [Kind.codedBatch, 1, 65_536],
    [Kind.message, 0, 16_384],
    [Kind.block, 0, 16_384],
  ];
  assert.deepEqual(new Set(lengths.map(([kind]) => kind)), new Set(Object.values(Kind)));
  for (const [kind, least, most] of lengths) {
    assert.deepEqual(lengthsOf(kind, format), { least, most });
    for (const length of [least - 1, least, most, most + 1].filter((length) => length >= 0)) {
      const reader = new MessageStream(format);
      reader.push(new Writer().u8(kind).u24(length).take());
      const isAllowed = length >= least && length <= most;
      if (isAllowed) {
        assert.equal(reader.take()?.payload.length, length === 0 ? 0 : undefined);
      } else {
        assert.throws(() => reader.take(), WireError, `kind ${kind} of ${length} bytes`);
        assert.throws(() => encodeMessage(kind, new Uint8Array(length), format), RangeError);
      }
    }
  }
});

test("a bad header is refused once its four bytes are there, and for good", () => {
  const reader = new MessageStream(format);
  reader.push(fromHex("23 00 00"));
  assert.equal(reader.take(), undefined);
  reader.push(fromHex("00"));
  const fault = new WireError("no message has the code 35: this is not a Trimaran peer");
  assert.throws(() => reader.take(), fault);
  reader.push(stream);
  assert.throws(() => reader.take(), fault);
});

test("a length that is claimed sets no memory aside", () => {
  const reader = new MessageStream(format);
  reader.push(new Writer().u8(Kind.batch).u24(65_536).take());
  assert.equal(reader.take(), undefined);
  assert(reader.capacity <= 16, `${reader.capacity} bytes`);
  const full = new MessageStream(format);
  full.push(new Uint8Array([Kind.keepAlive, 0, 0, 0, Kind.keepAlive, 0, 0, 0]));
  assert.equal(full.take()?.kind, Kind.keepAlive);
  full.push(Uint8Array.of(Kind.keepAlive, 0, 0, 0));
  assert.equal(full.capacity, 8, "room of a message that was taken");
  // Taken messages do not make it grow either.
  const long = new MessageStream(format);
  for (let at = 0; at < 1000; at += 1) {
    long.push(stream);
    takeAll(long);
  }
  assert(long.capacity <= 4 * stream.length, `${long.capacity} bytes`);
});

test("each reason of a refusal reads back, and is told to people", () => {
  const both = "install the same release on both";
  const refusals: [Refusal, string][] = [
    [
      { reason: "versions", listener: { highest: 7, lowest: 6 }, connector: { highest: 5, lowest: 5 } },
      `the listener speaks versions 6 to 7 of the wire, this side version 5: ${both}`,
    ],
    [
      { reason: "applications", listener: "robot/1", connector: "trimaran/4" },
      `the listener speaks robot/1, this side trimaran/4: ${both}`,
    ],
    [{ reason: "not taken", code: 3, text: "x".repeat(400) }, "x".repeat(400)],
    [
      { reason: "lane", session: (1n << 64n) - 1n, lane: 3 },
      "the channel 3 came twice or from a peer that calls itself something else",
    ],
    [{ reason: "unpaired", session: 5n }, "another lane of the link did not come in time"],
    [{ reason: "busy" }, "the listener has too many peers or handshakes under way: try again"],
    [
      { reason: "key", claimed: "display", known: "culler" },
      "this side claims to be display, and the listener knows its key as that of culler",
    ],
    [
      {
        reason: "channels",
        number: 3,
        listener: { name: "back", sizes: { kind: "frames", header: 8, item: 3 } },
        connector: undefined,
      },
      "channel 3 of the listener is `back` of frames with headers of 8 and items of 3 bytes, that of this " +
        `side missing: ${both}`,
    ],
  ];
  for (const [number, [refusal, text]] of refusals.entries()) {
    const payload = encodeRefuse(refusal);
    assert.equal(payload[2], number);
    assert.deepEqual(decodeRefuse(payload), refusal);
    assert.equal(describeRefusal(refusal), text);
    const longer = concat(payload, new Uint8Array(1));
    if (refusal.reason === "versions") {
      assert.equal(decodeRefuse(longer).reason, "versions");
    } else {
      assert.throws(() => decodeRefuse(longer), new WireError("1 bytes too many"));
    }
  }
  const connector = { highest: 5, lowest: 4 };
  for (const [bytes, version] of [
    ["06 00 ff ff", 6],
    ["06 00 05", 6],
    ["04 00 00 04 05", 4],
  ] as const) {
    const listener = { highest: version, lowest: version };
    assert.deepEqual(decodeRefuse(fromHex(bytes)), { reason: "versions", listener, connector });
  }
  assert.throws(() => decodeRefuse(fromHex("04 00 07")), WireError);
});

test("what is no hello or close is refused, and texts are cut", () => {
  const hello = {
    versions: { highest: 5, lowest: 4 },
    application: "trimaran/4",
    session: 1n,
    lane: "bulk",
    idleTimeout: 20_000,
    introduction: new Uint8Array(0),
  } as const;
  const payload = encodeHello(hello);
  assert.deepEqual(decodeHello(payload), hello);
  for (let length = 0; length < payload.length; length += 1) {
    assert.throws(() => decodeHello(payload.subarray(0, length)), WireError);
  }
  assert.throws(() => decodeHello(fromHex("54 52 49 4e 04 00")), /magic number/);
  const channels = encodeChannelsHello({ ...hello, channels: [] });
  assert.throws(() => decodeChannelsHello(channels), new WireError("no channels"));
  assert.throws(() => decodeClose(fromHex("03 00 00")), new WireError("1 bytes too many"));
  assert.equal(decodeClose(encodeClose({ code: 2, text: "é".repeat(300) })).text, "é".repeat(100));
});

test("a listener may choose a version of the wire that was offered and names itself", () => {
  const answer = { idleTimeout: 20_000, introduction: Uint8Array.of(7) };
  const read = (version: number) => decodeVersionedAccept(encodeVersionedAccept({ version, ...answer }));
  assert.deepEqual(read(5), { version: 5, ...answer });
  for (const version of [4, 6]) {
    const text = `the listener chose version ${version} of the wire, which was not offered`;
    assert.throws(() => read(version), new WireError(text));
  }
});
