/** The protocol of the README, and its robot as a test plays it: a listener over fake connections. */

import assert from "node:assert/strict";
import { type Of, record, tagged, text, u32, whole } from "../src/codec.ts";
import { type ConnectOptions, connect } from "../src/connect.ts";
import { struct } from "../src/fixed.ts";
import { encodeVersionedAccept, LANES, type LaneId } from "../src/handshake.ts";
import { itemsOf } from "../src/items.ts";
import { encodeMessage, type Format, Kind, type Message, MessageStream } from "../src/messages.ts";
import { defineProtocol, formatOf } from "../src/protocol.ts";
import { FakeClock, FakeConnection, settled, takeAll } from "./support.ts";

export const POINT = struct({ x: "f32", y: "f32", z: "f32" });

export const ROBOT = defineProtocol({
  name: "robot/1",
  hello: record({ name: text(), map: u32 }),
  latest: POINT,
  header: POINT,
  items: itemsOf(POINT),
  message: tagged("command", { Stop: {}, Play: { sound: text() } }),
});

type Hello = Of<typeof ROBOT.hello>;

export const US: Hello = { name: "panel", map: 7 };
export const THEM: Hello = { name: "robot", map: 7 };
export const { encode: encodeHelloOf } = whole(ROBOT.hello);
export const { encode: encodeCommand } = whole(ROBOT.message);
export const { encode: encodePoint } = whole(POINT);

/** The payload of an accept with version 5. */
export const acceptOf = (hello: Hello, idleTimeout = 20_000) =>
  encodeVersionedAccept({ version: 5, idleTimeout, introduction: encodeHelloOf(hello) });

const NOTHING = new Uint8Array(0);
const FORMAT = formatOf(ROBOT);

/** A listener. The test says what it does. */
export class Robot {
  readonly clock = new FakeClock();
  readonly connections = new Map<LaneId, FakeConnection>();
  readonly #formatOf: (lane: LaneId) => Format;

  constructor(formatOf: (lane: LaneId) => Format = () => FORMAT) {
    this.#formatOf = formatOf;
  }

  connect(options: Partial<ConnectOptions<Hello>> = {}) {
    const fakes = { session: 5n, clock: this.clock, open: (_: string, lane: LaneId) => this.open(lane) };
    return connect("ws://two:7400", ROBOT, { hello: US, ...fakes, ...options });
  }

  async open(lane: LaneId): Promise<FakeConnection> {
    const connection = new FakeConnection();
    this.connections.set(lane, connection);
    return connection;
  }

  connection(lane: LaneId): FakeConnection {
    const connection = this.connections.get(lane);
    assert(connection !== undefined, `the lane ${lane} is not open`);
    return connection;
  }

  say(lane: LaneId, kind: Kind, payload: Uint8Array = NOTHING): void {
    this.connection(lane).onBytes?.(encodeMessage(kind, payload, this.#formatOf(lane)));
  }

  /** The messages on a lane since the last call. */
  heard(lane: LaneId): Message[] {
    const stream = new MessageStream(this.#formatOf(lane));
    for (const bytes of this.connection(lane).sent.splice(0)) {
      stream.push(bytes);
    }
    const messages = takeAll(stream);
    assert.equal(stream.pending, 0);
    return messages;
  }

  /** Accepts the peer on all lanes. */
  accept(idleTimeout?: number): void {
    for (const lane of this.connections.keys()) {
      this.heard(lane);
      this.say(lane, Kind.versionedAccept, acceptOf(THEM, idleTimeout));
    }
  }

  get areAllClosed(): boolean {
    return [...this.connections.values()].every(({ isClosed }) => isClosed);
  }
}

/** An established link, and its listener. */
export async function linked(options: Partial<ConnectOptions<Hello>> = {}) {
  const robot = new Robot();
  const connecting = robot.connect(options);
  await opened(robot);
  robot.accept();
  return { robot, link: await connecting };
}

/** Waits until the listener has a hello on each lane. */
export async function opened({ connections }: Robot): Promise<void> {
  while (connections.size < LANES.length) {
    await settled();
  }
  await settled();
}
