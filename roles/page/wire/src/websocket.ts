/**
 * A lane's bytes over a WebSocket.
 *
 * They are sent in binary messages, whose boundaries have no meaning.
 */

import type { Connection } from "./lane.ts";

/** The most bytes of a binary message. */
export const MOST_PER_MESSAGE = 65_536;

/** The used part of a `WebSocket`, of a browser or of another implementation. */
export interface Socket {
  binaryType: string;
  readonly bufferedAmount: number;
  onopen: ((event: never) => void) | null;
  onmessage: ((event: never) => void) | null;
  onclose: ((event: never) => void) | null;
  onerror: ((event: never) => void) | null;
  send(data: Uint8Array<ArrayBuffer>): void;
  close(): void;
}

/** Opens a connection to `url`, such as `ws://host:port/path`. */
export function openWebSocket(
  url: string,
  make: (url: string) => Socket = (url) => new WebSocket(url) as Socket,
): Promise<Connection> {
  return new Promise((resolve, reject) => {
    const socket = make(url);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => resolve(new WebSocketConnection(socket));
    // The query may hold a secret.
    const [where] = url.split(/[?#]/);
    // Browsers say nothing here, and the end follows. Node says why, and its first WebSocket nothing more.
    socket.onerror = ({ message = "" }: ErrorEvent) => {
      if (message !== "") {
        reject(new Error(`cannot connect to ${where}: ${message}`));
      }
    };
    socket.onclose = (event: CloseEvent) =>
      reject(new Error(`cannot connect to ${where}: ${reasonOf(event)}`));
  });
}

class WebSocketConnection implements Connection {
  onBytes: ((bytes: Uint8Array) => void) | undefined;
  onEnd: ((why: string) => void) | undefined;
  readonly #socket: Socket;

  constructor(socket: Socket) {
    this.#socket = socket;
    socket.onmessage = (event: MessageEvent) => this.#receive(event);
    socket.onclose = (event: CloseEvent) => this.onEnd?.(reasonOf(event));
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
