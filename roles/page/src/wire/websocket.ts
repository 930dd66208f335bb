/**
 * A lane's bytes over a WebSocket.
 *
 * They are sent in binary messages, whose boundaries have no meaning.
 */

import { withoutSecrets } from "./errors.ts";
import type { Channel } from "./lane.ts";

/** The most bytes of a binary message. */
export const MOST_PER_MESSAGE = 65_536;

/** The used part of a `WebSocket`. */
export type Socket = Pick<
  WebSocket,
  "binaryType" | "bufferedAmount" | "send" | "close" | "onopen" | "onmessage" | "onclose"
>;

/** Opens a connection to `url`, such as `ws://host:port/path`. */
export function openWebSocket(
  url: string,
  make: (url: string) => Socket = (url) => new WebSocket(url),
): Promise<Channel> {
  return new Promise((resolve, reject) => {
    const socket = make(url);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => resolve(new WebSocketChannel(socket));
    const where = withoutSecrets(url);
    socket.onclose = (event) => reject(new Error(`cannot connect to ${where}: ${reasonOf(event)}`));
  });
}

class WebSocketChannel implements Channel {
  onBytes: ((bytes: Uint8Array) => void) | undefined;
  onEnd: ((why: string) => void) | undefined;
  readonly #socket: Socket;

  constructor(socket: Socket) {
    this.#socket = socket;
    socket.onmessage = (event) => this.#receive(event);
    socket.onclose = (event) => this.onEnd?.(reasonOf(event));
  }

  send(bytes: Uint8Array<ArrayBuffer>): void {
    for (let from = 0; from < bytes.length; from += MOST_PER_MESSAGE) {
      this.#socket.send(bytes.subarray(from, from + MOST_PER_MESSAGE));
    }
  }

  buffered(): number {
    return this.#socket.bufferedAmount;
  }

  close(): void {
    this.#socket.onmessage = null;
    this.#socket.onclose = null;
    this.#socket.close();
  }

  #receive(event: MessageEvent): void {
    const data: unknown = event.data;
    if (data instanceof ArrayBuffer) {
      this.onBytes?.(new Uint8Array(data));
    } else {
      const { onEnd } = this;
      this.close();
      onEnd?.("the peer sent text where only bytes may come");
    }
  }
}

function reasonOf({ code, reason }: { code: number; reason: string }): string {
  return reason === "" ? `the connection ended (code ${code})` : `${reason} (code ${code})`;
}
