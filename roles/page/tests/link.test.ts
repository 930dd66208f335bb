/** A link over fake connections, with the test as listener. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { TRIMARAN } from "../src/proto/identity.ts";
import { WireError, Writer } from "../src/wire/bytes.ts";
import {
  CODE_NOT_TAKEN,
  decodeClose,
  decodeHello,
  encodeClose,
  encodeRefuse,
  LANES,
  type LaneName,
  type Refusal,
} from "../src/wire/handshake.ts";
import { type Admission, connect, type Link } from "../src/wire/link.ts";
import { LinkError } from "../src/wire/meeting.ts";
import { encodeMessage, Kind, type Message, MessageStream } from "../src/wire/messages.ts";
import { endOf, FakeChannel, FakeClock, range, settled, takeAll } from "./support.ts";

const US = Uint8Array.of(1, 0, 0);
const THEM = Uint8Array.of(0, 0, 0);
const NOTHING = new Uint8Array(0);

/** A listener, and the events of a link to it. */
class Listener {
  readonly clock = new FakeClock();
  readonly channels = new Map<LaneName, FakeChannel>();
  readonly told: unknown[] = [];
  admission: Admission = { isTaken: true, mostIds: 100 };
  fault: Error | undefined;

  connect(): Promise<Link> {
    const tell = (what: string) => (payload: Uint8Array) => {
      this.told.push([what, ...payload]);
      if (this.fault !== undefined) {
        throw this.fault;
      }
    };
    return connect("ws://two:7400", US, {
      application: TRIMARAN,
      session: 5n,
      clock: this.clock,
      open: (_, lane) => this.open(lane),
      admit: (introduction) => {
        assert.deepEqual(introduction, THEM);
        return this.admission;
      },
      handlers: {
        onFrame: ({ number, ids }) => this.told.push(["frame", number, ...ids]),
        onMessage: tell("message"),
        onBlock: tell("block"),
        onValue: tell("value"),
        onEnd: (end) => this.told.push(end),
      },
    });
  }

  async open(lane: LaneName): Promise<FakeChannel> {
    const channel = new FakeChannel();
    this.channels.set(lane, channel);
    return channel;
  }

  channel(lane: LaneName): FakeChannel {
    const channel = this.channels.get(lane);
    assert(channel !== undefined, `the ${lane} lane is not open`);
    return channel;
  }

  say(lane: LaneName, kind: Kind, payload: Uint8Array = NOTHING): void {
    this.channel(lane).onBytes?.(encodeMessage(kind, payload, TRIMARAN.format));
  }

  /** The messages on a lane since the last call. */
  heard(lane: LaneName): Message[] {
    const stream = new MessageStream(TRIMARAN.format);
    for (const bytes of this.channel(lane).sent.splice(0)) {
      stream.push(bytes);
    }
    const messages = takeAll(stream);
    assert.equal(stream.pending, 0);
    return messages;
  }

  /** Accepts the peer on all lanes. */
  accept(): void {
    for (const lane of LANES) {
      this.heard(lane);
      this.say(lane, Kind.accept, THEM);
    }
  }

  get areAllClosed(): boolean {
    return [...this.channels.values()].every(({ isClosed }) => isClosed);
  }
}

/** An established link, and its listener. */
async function linked(change: (listener: Listener) => void = () => {}) {
  const listener = new Listener();
  change(listener);
  const link = listener.connect();
  await settled();
  listener.accept();
  const made = await link;
  listener.clock.pass(0);
  return { listener, link: made };
}

test("each lane says hello with the same session, and the link is there once all are accepted", async () => {
  const listener = new Listener();
  const link = listener.connect();
  await settled();
  for (const lane of LANES) {
    const [hello, ...more] = listener.heard(lane);
    assert(hello !== undefined && more.length === 0);
    const expected = { application: "trimaran/3", session: 5n, lane, introduction: US };
    assert.deepEqual(decodeHello(hello.payload), expected);
  }
  let isThere = false;
  link.then(() => {
    isThere = true;
  });
  for (const lane of LANES) {
    await settled();
    assert.equal(isThere, false, `before the ${lane} lane`);
    listener.say(lane, Kind.accept, THEM);
  }
  assert.deepEqual((await link).listener, THEM);
});

test("what comes before the other lanes are accepted is not lost", async () => {
  const listener = new Listener();
  const link = listener.connect();
  await settled();
  listener.say("messages", Kind.accept, THEM);
  listener.say("messages", Kind.message, Uint8Array.of(7));
  for (const lane of LANES.filter((lane) => lane !== "messages")) {
    listener.say(lane, Kind.accept, THEM);
  }
  await link;
  assert.deepEqual(listener.told, []);
  listener.clock.pass(0);
  assert.deepEqual(listener.told, [["message", 7]]);
});

test("a refusal says why, and all lanes are given up", async () => {
  const listener = new Listener();
  const link = listener.connect();
  await settled();
  const refusal: Refusal = { reason: "busy" };
  listener.say("latest", Kind.accept, THEM);
  listener.say("bulk", Kind.refuse, encodeRefuse(refusal));
  const error = await link.then(
    () => assert.fail("no link"),
    (error: unknown) => error,
  );
  assert(error instanceof LinkError);
  assert.deepEqual([error.refusal, listener.areAllClosed], [refusal, true]);
  assert.equal(listener.clock.waiting, 0, "no timer is left");
});

test("a listener that does not answer, answers otherwise, or is gone makes no link", async () => {
  const cases: [string, (listener: Listener) => void, RegExp][] = [
    ["silence", (listener) => listener.clock.pass(20_000), /nothing came|did not answer/],
    ["a block", (listener) => listener.say("bulk", Kind.block), /block came instead of an answer/],
    ["the end", (listener) => listener.channel("frames").onEnd?.("reset"), /frames lane ended: reset/],
    ["another", (listener) => listener.say("bulk", Kind.accept, US), /call themselves differently/],
  ];
  for (const [name, happen, text] of cases) {
    const listener = new Listener();
    const link = listener.connect();
    await settled();
    const others = name === "another" ? LANES.slice(0, 3) : [];
    for (const lane of others) {
      listener.say(lane, Kind.accept, THEM);
    }
    happen(listener);
    const isIt = (error: unknown) => error instanceof LinkError && text.test(error.message);
    await assert.rejects(link, isIt, name);
    assert(listener.areAllClosed, name);
    assert.equal(listener.clock.waiting, 0, name);
  }
});

test("a connection that opens after another failed is closed", async () => {
  const listener = new Listener();
  let openLate = (_: FakeChannel) => {};
  const open = listener.open.bind(listener);
  listener.open = (lane) => {
    if (lane === "frames") {
      return Promise.reject(new Error("no route"));
    }
    return lane === "bulk" ? new Promise((resolve) => (openLate = resolve)) : open(lane);
  };
  await assert.rejects(listener.connect(), /no route/);
  const late = new FakeChannel();
  openLate(late);
  await settled();
  assert(listener.areAllClosed && late.isClosed && late.sent.length === 0);
});

test("a listener that is not taken is told so", async () => {
  const listener = new Listener();
  listener.admission = { isTaken: false, why: "it holds no scene" };
  const link = listener.connect();
  await settled();
  listener.accept();
  await assert.rejects(link, new LinkError("it holds no scene"));
  for (const lane of LANES) {
    const [close] = listener.heard(lane);
    assert.deepEqual(close && decodeClose(close.payload), {
      code: CODE_NOT_TAKEN,
      text: "it holds no scene",
    });
  }
  assert(listener.areAllClosed);
});

test("what is said arrives on its lane, both ways, and is counted", async () => {
  const { listener, link } = await linked();
  link.sendMessage(Uint8Array.of(1));
  link.sendBlock(Uint8Array.of(2, 3));
  link.publish(new Uint8Array(72));
  assert.deepEqual(listener.heard("messages"), [{ kind: Kind.message, payload: Uint8Array.of(1) }]);
  assert.deepEqual(listener.heard("bulk"), [{ kind: Kind.block, payload: Uint8Array.of(2, 3) }]);
  assert.deepEqual(listener.heard("latest"), [{ kind: Kind.latestValue, payload: new Uint8Array(72) }]);
  listener.say("messages", Kind.message, Uint8Array.of(4));
  listener.say("bulk", Kind.keepAlive);
  listener.say("bulk", Kind.block, Uint8Array.of(5));
  listener.say("frames", Kind.begin, new Writer().u32(9).bytes(new Uint8Array(72)).take());
  listener.say("frames", Kind.batch, new Writer().u32(1).u32(258).take());
  listener.say("frames", Kind.end, endOf(9, [1, 258]));
  listener.say("frames", Kind.begin, new Writer().u32(10).bytes(new Uint8Array(72)).take());
  listener.say("frames", Kind.end, endOf(10, [3]));
  assert.deepEqual(listener.told, [
    ["message", 4],
    ["block", 5],
    ["frame", 9, 1, 258],
  ]);
  const accept = 4 + THEM.length;
  const { latest, frames, messages, bulk } = link.bytes;
  const hello = latest.sent - 76;
  assert.equal(hello, 4 + 6 + 11 + 1 + 1 + US.length);
  assert.deepEqual(frames, { sent: hello, received: accept + 2 * (80 + 20) + 12 });
  assert.deepEqual(messages, { sent: hello + 5, received: accept + 5 });
  assert.deepEqual(bulk, { sent: hello + 6, received: accept + 4 + 5 });
});

test("only the newest value is sent once there is room again", async () => {
  const { listener, link } = await linked();
  const value = (number: number) => new Uint8Array(72).fill(number);
  const channel = listener.channel("latest");
  const sent = () => listener.heard("latest").map(({ payload }) => payload[0]);
  channel.waiting = 4096;
  link.publish(value(1));
  assert.deepEqual(sent(), [1], "a few KiB are no reason to wait");
  channel.waiting = 4097;
  for (const number of range(2, 6)) {
    link.publish(value(number));
  }
  listener.clock.pass(100);
  assert.deepEqual(sent(), []);
  channel.waiting = 0;
  listener.clock.pass(4);
  assert.deepEqual(sent(), [5]);
  link.publish(value(6));
  assert.deepEqual(sent(), [6]);
});

test("a lane that says nothing is kept alive each five seconds", async () => {
  const { listener, link } = await linked();
  const keptAlive = (lane: LaneName) => listener.heard(lane).map(({ kind }) => kind === Kind.keepAlive);
  listener.clock.pass(4_999);
  assert.deepEqual(LANES.map(keptAlive), [[], [], [], []]);
  link.sendMessage(NOTHING);
  listener.heard("messages");
  listener.clock.pass(1);
  assert.deepEqual(LANES.map(keptAlive), [[true], [true], [], [true]]);
  listener.clock.pass(4_998);
  assert.deepEqual(keptAlive("messages"), []);
  listener.clock.pass(1);
  assert.deepEqual(keptAlive("messages"), [true]);
});

test("a peer that is silent for twenty seconds on a lane is lost, and a keep-alive is enough", async () => {
  const { listener } = await linked();
  for (const _ of range(0, 3)) {
    listener.clock.pass(19_999);
    for (const lane of LANES) {
      listener.say(lane, Kind.keepAlive);
    }
  }
  listener.clock.pass(19_999);
  for (const lane of LANES.filter((lane) => lane !== "frames")) {
    listener.say(lane, Kind.keepAlive);
  }
  assert.deepEqual(listener.told, []);
  listener.clock.pass(1);
  assert.deepEqual(listener.told, [{ why: "lost", text: "nothing came on the frames lane for 20 s" }]);
  assert(listener.areAllClosed);
  assert.equal(listener.clock.waiting, 0);
});

test("this side leaves with a close on each lane", async () => {
  const { listener, link } = await linked();
  link.close(1, "it was interrupted");
  for (const lane of LANES) {
    const [close, ...more] = listener.heard(lane);
    assert(close?.kind === Kind.close && more.length === 0);
    assert.deepEqual(decodeClose(close.payload), { code: 1, text: "it was interrupted" });
  }
  assert.deepEqual(listener.told, [{ why: "left", code: 1, text: "it was interrupted" }]);
  assert(listener.areAllClosed && link.isOver);
  link.close(1, "again");
  link.sendMessage(NOTHING);
  link.publish(new Uint8Array(72));
  listener.clock.pass(60_000);
  assert.equal(listener.told.length, 1);
  assert.deepEqual(
    LANES.map((lane) => listener.heard(lane)),
    [[], [], [], []],
  );
});

test("a peer that leaves is heard to the end on all lanes", async () => {
  const { listener } = await linked();
  const close = encodeClose({ code: 0, text: "the session is over" });
  listener.say("latest", Kind.close, close);
  listener.say("messages", Kind.message, Uint8Array.of(1));
  listener.say("messages", Kind.close, close);
  listener.channel("frames").onEnd?.("gone");
  assert.deepEqual(listener.told, [["message", 1]]);
  listener.say("bulk", Kind.close, close);
  const closed = { why: "closed", code: 0, text: "the session is over" };
  assert.deepEqual(listener.told, [["message", 1], closed]);
  assert.equal(listener.clock.waiting, 0);
});

test("a peer that leaves on one lane alone has left two seconds later", async () => {
  const { listener } = await linked();
  listener.say("bulk", Kind.close, encodeClose({ code: 5, text: "" }));
  listener.clock.pass(1_999);
  assert.deepEqual(listener.told, []);
  listener.clock.pass(1);
  assert.deepEqual(listener.told, [{ why: "closed", code: 5, text: "" }]);
  assert(listener.areAllClosed);
});

test("a peer that breaks the protocol is let go at once", async () => {
  const cases: [string, (listener: Listener) => void, string][] = [
    [
      "a bad header",
      ({ channels }) => channels.get("bulk")?.onBytes?.(Uint8Array.of(0x40, 1, 0x40, 0)),
      "on the bulk lane: a block cannot have 16385 bytes, only 0 to 16384",
    ],
    [
      "a message on another lane",
      (listener) => listener.say("bulk", Kind.message),
      "on the bulk lane: a message came, which does not belong there",
    ],
    [
      "a numbered value over a lane in order",
      (listener) => listener.say("latest", Kind.numberedValue, new Uint8Array(76)),
      "on the latest lane: a numbered value came, which does not belong there",
    ],
    [
      "ids outside of a frame",
      (listener) => listener.say("frames", Kind.batch, new Uint8Array(4)),
      "on the frames lane: ids came outside of a frame",
    ],
    [
      "what the application cannot read",
      (listener) => {
        listener.fault = new WireError("no item");
        listener.say("bulk", Kind.block, NOTHING);
        listener.told.shift();
      },
      "on the bulk lane: no item",
    ],
  ];
  for (const [name, happen, text] of cases) {
    const { listener, link } = await linked();
    happen(listener);
    assert.deepEqual(listener.told, [{ why: "violation", text }], name);
    assert(listener.areAllClosed && link.isOver, name);
  }
});

test("a lane that ends without a close is a lost peer", async () => {
  const { listener } = await linked();
  listener.channel("messages").onEnd?.("reset");
  assert.deepEqual(listener.told, [{ why: "lost", text: "the messages lane ended: reset" }]);
});
