/** One lane or channel of a link, over a connection of its own. */

import { WireError } from "./bytes.ts";
import { type Close, decodeClose, encodeClose } from "./handshake.ts";
import { encodeMessage, type Format, Kind, type Message, MessageStream } from "./messages.ts";

/** A connection that carries bytes both ways, in order. */
export interface Connection {
  send(bytes: Uint8Array<ArrayBuffer>): void;
  /** How many bytes wait to be sent. */
  buffered(): number;
  /** Ends the connection after pending bytes are sent. */
  close(): void;
  onBytes: ((bytes: Uint8Array) => void) | undefined;
  /** Called when the connection ends other than by `close`. */
  onEnd: ((why: string) => void) | undefined;
}

/** A clock, replaceable in tests. */
export interface Clock {
  /** Milliseconds since some moment. */
  now(): number;
  /** Calls once after this many milliseconds. Returns a function to cancel it. */
  after(milliseconds: number, call: () => void): () => void;
}

/** How a lane ended: the peer left, the connection was lost, or the peer broke the protocol. */
export type LaneEnd =
  | ({ readonly why: "closed" } & Close)
  | { readonly why: "lost"; readonly text: string }
  | { readonly why: "violation"; readonly text: string };

export interface LaneOptions {
  readonly format: Format;
  readonly clock: Clock;
}

/** The idle timeout that this side asks for: milliseconds of silence after which the peer counts as lost. */
export const IDLE_TIMEOUT = 20_000;

/** The shortest idle timeout, milliseconds. */
const SHORTEST = 50;

/** So often an idle side sends a keep-alive within the idle timeout. */
const KEEP_ALIVES = 4;

/** Sends and receives messages, keeps the connection alive, and detects when the peer is gone. */
export class Lane {
  /** The lane in texts for people: `frames lane`. */
  readonly title: string;
  /** Bytes carried, headers included. */
  readonly bytes = { sent: 0, received: 0 };
  /** Called once, but not if this side leaves. */
  onEnd: ((end: LaneEnd) => void) | undefined;

  readonly #connection: Connection;
  readonly #options: LaneOptions;
  readonly #stream: MessageStream;
  #listener: ((message: Message) => void) | undefined;
  #idleTimeout = IDLE_TIMEOUT;
  #lastSent: number;
  #lastReceived: number;
  readonly #timers = [() => {}, () => {}];
  #connectionEnd: string | undefined;
  isOver = false;

  constructor(title: string, connection: Connection, options: LaneOptions) {
    [this.title, this.#connection, this.#options] = [title, connection, options];
    this.#stream = new MessageStream(options.format);
    this.#lastSent = options.clock.now();
    this.#lastReceived = this.#lastSent;
    connection.onBytes = (bytes) => this.#receive(bytes);
    connection.onEnd = (why) => {
      this.#connectionEnd = why;
      this.#deliver();
    };
    this.#keepAlive();
    this.#watch();
  }

  /** The peer asks for this idle timeout, milliseconds. The shorter one holds for both sides. */
  agree(theirs: number): void {
    this.#idleTimeout = Math.max(SHORTEST, Math.min(IDLE_TIMEOUT, theirs));
    this.#keepAlive();
    this.#watch();
  }

  /** How many bytes wait to be sent. */
  buffered(): number {
    return this.#connection.buffered();
  }

  /** Delivers messages from now on. Without a listener they wait, and so does the end of the lane. */
  listen(listener: ((message: Message) => void) | undefined): void {
    this.#listener = listener;
    this.#deliver();
  }

  send(kind: Kind, payload: Uint8Array): void {
    if (this.isOver) {
      return;
    }
    const bytes = encodeMessage(kind, payload, this.#options.format);
    this.#lastSent = this.#options.clock.now();
    this.bytes.sent += bytes.length;
    this.#connection.send(bytes);
  }

  /** Sends the reason of the close, if any, and ends the connection. */
  leave(close?: Close): void {
    if (close !== undefined) {
      this.send(Kind.close, encodeClose(close));
    }
    this.#stop();
  }

  #receive(bytes: Uint8Array): void {
    this.#lastReceived = this.#options.clock.now();
    this.bytes.received += bytes.length;
    // Browsers slow down timers of hidden pages, but not arrivals.
    this.#keepAlive();
    this.#stream.push(bytes);
    this.#deliver();
  }

  #deliver(): void {
    try {
      while (!this.isOver && this.#listener !== undefined) {
        const message = this.#stream.take();
        if (message === undefined) {
          break;
        }
        this.#take(message, this.#listener);
      }
    } catch (error) {
      if (!(error instanceof WireError)) {
        throw error;
      }
      this.#end({ why: "violation", text: `on the ${this.title}: ${error.message}` });
    }
    if (this.#listener !== undefined && this.#connectionEnd !== undefined) {
      this.#end({ why: "lost", text: `the ${this.title} ended: ${this.#connectionEnd}` });
    }
  }

  #take(message: Message, listener: (message: Message) => void): void {
    if (message.kind === Kind.close) {
      this.#end({ why: "closed", ...decodeClose(message.payload) });
    } else if (message.kind !== Kind.keepAlive) {
      listener(message);
    }
  }

  #keepAlive(): void {
    const longest = this.#idleTimeout / KEEP_ALIVES;
    if (this.#options.clock.now() - this.#lastSent >= longest) {
      this.send(Kind.keepAlive, new Uint8Array(0));
    }
    this.#again(0, this.#lastSent + longest, () => this.#keepAlive());
  }

  #watch(): void {
    const idleTimeout = this.#idleTimeout;
    if (this.#options.clock.now() - this.#lastReceived >= idleTimeout) {
      this.#end({ why: "lost", text: `nothing came on the ${this.title} for ${idleTimeout / 1000} s` });
    } else {
      this.#again(1, this.#lastReceived + idleTimeout, () => this.#watch());
    }
  }

  #again(timer: 0 | 1, when: number, call: () => void): void {
    this.#timers[timer]?.();
    if (!this.isOver) {
      this.#timers[timer] = this.#options.clock.after(when - this.#options.clock.now(), call);
    }
  }

  #end(end: LaneEnd): void {
    if (!this.isOver) {
      this.#stop();
      this.onEnd?.(end);
    }
  }

  #stop(): void {
    if (!this.isOver) {
      this.isOver = true;
      for (const callOff of this.#timers) {
        callOff();
      }
      this.#connection.onBytes = undefined;
      this.#connection.onEnd = undefined;
      this.#connection.close();
    }
  }
}

/** The clock of the machine. */
export const systemClock: Clock = {
  now: () => performance.now(),
  after(milliseconds, call) {
    const timer = setTimeout(call, Math.max(0, milliseconds));
    return () => clearTimeout(timer);
  },
};
