/** The lanes of a link as its user sees them: each receives, and each sends. */

import type { NewFrame } from "./frameSender.ts";
import type { Frame } from "./frames.ts";
import type { Receiver } from "./inbox.ts";
import type { Waiting } from "./waiter.ts";

/** Values that replace each other: only the newest is received. */
export interface LatestLane<Latest> extends Receiver<Latest> {
  /** Sends a value, unless a newer one replaces it first. Never waits. */
  publish(value: Latest): void;
}

/** Frames: all items of a frame count. */
export interface FramesLane<Header, Items> extends Receiver<Frame<Header, Items>> {
  /**
   * Sends a frame behind those before it, and returns its number once there is room for another one.
   *
   * The items must not change until then. If it is aborted within the frame, the peer gets a part of it, and
   * knows that items are missing.
   */
  send(frame: NewFrame<Header, Items>, options?: Waiting): Promise<number>;
}

/** Messages, or blocks of bytes: all arrive, in order. */
export interface MessagesLane<Message> extends Receiver<Message> {
  /**
   * Sends a message at once, and resolves when there is room for another one. Await it if you send much; an
   * error that nobody awaits is no unhandled one. An aborted wait does not call the message back.
   *
   * Rejects with a `RangeError` if the message is too large, and with a `LinkError` if the link has ended.
   */
  send(message: Message, options?: Waiting): Promise<void>;
}
