/** A connection over a fake WebSocket. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { openWebSocket, type Socket } from "../src/websocket.ts";
import { concat } from "./support.ts";

class FakeSocket {
  binaryType: BinaryType = "blob";
  bufferedAmount = 0;
  onopen: (() => void) | null = null;
  onerror: ((event: { message?: string }) => void) | null = null;
  onmessage: ((event: { data: unknown }) => void) | null = null;
  onclose: ((event: { code: number; reason: string }) => void) | null = null;
  sent: Uint8Array[] = [];
  isClosed = false;

  send(bytes: Uint8Array): void {
    this.sent.push(bytes.slice());
  }

  close(): void {
    this.isClosed = true;
  }
}

function opening() {
  const socket = new FakeSocket();
  const connection = openWebSocket("ws://two:7400/culler", (url) => {
    assert.equal(url, "ws://two:7400/culler");
    return socket as unknown as Socket;
  });
  return { socket, connection };
}

async function opened() {
  const { socket, connection } = opening();
  socket.onopen?.();
  return { socket, connection: await connection };
}

test("what is sent is split into binary messages of at most 65,536 bytes", async () => {
  const { socket, connection } = await opened();
  assert.equal(socket.binaryType, "arraybuffer");
  const bytes = Uint8Array.from({ length: 140_000 }, (_, at) => at % 251);
  connection.send(bytes);
  assert.deepEqual(
    socket.sent.map((part) => part.length),
    [65_536, 65_536, 8_928],
  );
  assert.deepEqual(concat(...socket.sent), bytes);
  connection.send(bytes.slice(0, 65_536));
  assert.equal(socket.sent.length, 4, "a part that is full is the last one");
  socket.bufferedAmount = 5;
  assert.equal(connection.buffered(), 5);
});

test("bytes and the end of the connection are told", async () => {
  const { socket, connection } = await opened();
  const told: unknown[] = [];
  connection.onBytes = (bytes) => told.push([...bytes]);
  connection.onEnd = (why) => told.push(why);
  socket.onmessage?.({ data: Uint8Array.of(1, 2).buffer });
  socket.onclose?.({ code: 1006, reason: "" });
  assert.deepEqual(told, [[1, 2], "the connection ended (code 1006)"]);
});

test("text ends the connection", async () => {
  const { socket, connection } = await opened();
  const told: unknown[] = [];
  connection.onEnd = (why) => told.push(why);
  socket.onmessage?.({ data: "hello" });
  assert.deepEqual([told, socket.isClosed], [["the peer sent text where only bytes may come"], true]);
});

test("nothing is told after this side has closed", async () => {
  const { socket, connection } = await opened();
  connection.onEnd = () => assert.fail("told");
  connection.close();
  socket.onclose?.({ code: 1000, reason: "" });
  assert(socket.isClosed);
});

test("bytes and an end that nobody asks for are no error, and text still ends the connection", async () => {
  const { socket } = await opened();
  socket.onmessage?.({ data: new ArrayBuffer(1) });
  socket.onclose?.({ code: 1006, reason: "" });
  socket.onmessage?.({ data: "hello" });
  assert(socket.isClosed);
});

test("a connection that cannot be opened says why, in the error or else in its end", async () => {
  const { socket: failed, connection: never } = opening();
  failed.onerror?.({ message: "no such host" });
  await assert.rejects(never, new Error("cannot connect to ws://two:7400/culler: no such host"));
  const { socket, connection } = opening();
  socket.onerror?.({});
  socket.onclose?.({ code: 1006, reason: "no route" });
  await assert.rejects(connection, new Error("cannot connect to ws://two:7400/culler: no route (code 1006)"));
});
