/** The README's example, with a robot behind real WebSockets. */

import assert from "node:assert/strict";
import { once } from "node:events";
import { readFileSync } from "node:fs";
import type { AddressInfo } from "node:net";
import { after, test } from "node:test";
import WebSocket, { WebSocketServer } from "ws";

import { drive } from "../examples/panel.ts";
import { Writer } from "../src/bytes.ts";
import { connect } from "../src/connect.ts";
import { hashOf, loadHasher } from "../src/frames.ts";
import { decodeClose, decodeHello, LANES, type LaneName } from "../src/handshake.ts";
import { encodeMessage, Kind, MessageStream } from "../src/messages.ts";
import { formatOf } from "../src/protocol.ts";
import { acceptOf, encodeCommand, encodePoint, ROBOT, THEM, US } from "./robot.ts";
import { concat, fileOf, takeAll } from "./support.ts";

const FORMAT = formatOf(ROBOT);
const HERE = { x: 1, y: 0, z: 0.5 };
const POINTS = concat(encodePoint({ x: 4, y: 5, z: 6 }), encodePoint({ x: 7, y: 8, z: 9 }));
const hasher = await loadHasher();

/** All that the robot hears, by lane. */
const heard: Record<LaneName, unknown[]> = { latest: [], frames: [], messages: [], bulk: [] };

const server = new WebSocketServer({ host: "127.0.0.1", port: 0 });
const lanes = new Map<LaneName, (kind: Kind, payload: Uint8Array) => void>();
server.on("connection", (socket) => {
  const stream = new MessageStream(FORMAT);
  let lane: LaneName | undefined;
  socket.on("message", (data: Buffer) => {
    stream.push(data);
    for (const { kind, payload } of takeAll(stream)) {
      if (lane === undefined) {
        assert.equal(kind, Kind.hello);
        lane = decodeHello(payload).lane as LaneName;
        lanes.set(lane, (kind, payload) => socket.send(encodeMessage(kind, payload, FORMAT)));
        acceptAll();
      } else {
        take(lane, kind, payload);
      }
    }
  });
});

function acceptAll(): void {
  if (lanes.size === LANES.length) {
    for (const say of lanes.values()) {
      say(Kind.versionedAccept, acceptOf(THEM));
    }
  }
}

/** Answers a pose with what is seen from there, and `Stop` with `Stop`. */
function take(lane: LaneName, kind: Kind, payload: Uint8Array): void {
  heard[lane].push(kind === Kind.close ? decodeClose(payload).text : payload);
  if (kind === Kind.latestValue) {
    const number = heard.latest.length;
    const say = lanes.get("frames");
    say?.(Kind.begin, new Writer().u32(number).bytes(payload).take());
    say?.(Kind.batch, POINTS);
    const hash = hashOf(hasher.init().update(POINTS));
    say?.(Kind.end, new Writer().u32(number).u32(2).u64(hash).take());
  } else if (kind === Kind.message && payload[0] === 0) {
    lanes.get("messages")?.(Kind.message, payload);
  }
}

await once(server, "listening");
const url = `ws://127.0.0.1:${(server.address() as AddressInfo).port}/`;

after(() => server.close());

test("the README's example drives a robot", async (context) => {
  globalThis.WebSocket = WebSocket as unknown as typeof globalThis.WebSocket;
  const logged: unknown[] = [];
  context.mock.method(console, "log", (line: unknown) => logged.push(line));
  await drive(url);
  context.mock.restoreAll();
  assert.deepEqual(
    logged.filter((line) => !String(line).startsWith("frame 1 from 0")),
    [
      "robot has map 7",
      "frame 2 from 1: 4 5 6,7 8 9",
      "the robot answers: Stop",
      "the end: left, the shift is over",
    ],
  );
  while (!heard.messages.includes("the shift is over")) {
    await new Promise((resolve) => setTimeout(resolve, 1));
  }
  const commands = [{ command: "Play", sound: "bell" } as const, { command: "Stop" } as const];
  assert.deepEqual(heard.messages, [...commands.map(encodeCommand), "the shift is over"]);
  assert.deepEqual(heard.latest.slice(-2), [encodePoint(HERE), "the shift is over"]);
});

test("a WebSocket of another implementation may be given, and one that fails says so", async () => {
  lanes.clear();
  const link = await connect(url, ROBOT, { hello: US, webSocket: (url) => new WebSocket(url) });
  assert.deepEqual(link.peer, THEM);
  link.close();
  const nowhere = connect("ws://127.0.0.1:1/", ROBOT, { hello: US, webSocket: (url) => new WebSocket(url) });
  await assert.rejects(nowhere, {
    code: "unreachable",
    message: "cannot connect to ws://127.0.0.1:1/: connect ECONNREFUSED 127.0.0.1:1",
  });
});

test("the README shows the examples as they run", () => {
  const read = (name: string) => readFileSync(fileOf(`roles/page/wire/${name}`), "utf8");
  for (const name of ["examples/panel.ts", "examples/sensors.ts"]) {
    assert(read("README.md").includes(`\`\`\`ts\n${read(name)}\`\`\`\n`), `README.md and ${name} differ`);
  }
});
