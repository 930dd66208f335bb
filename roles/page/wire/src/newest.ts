/** Sends values of the latest lane: each replaces the one before. */

import type { Clock, Lane } from "./lane.ts";
import { Kind } from "./messages.ts";

/** Beyond this many unsent bytes, only the newest value is kept. */
const MOST_BUFFERED = 4096;

/** The polling interval for unsent bytes, milliseconds: a WebSocket has no event for it. */
const LOOK_EVERY = 4;

/** Keeps only the newest value if the lane is slower than the values. */
export class NewestSender {
  readonly #lane: Lane;
  readonly #clock: Clock;
  #waiting: Uint8Array | undefined;
  #callOff: (() => void) | undefined;
  #isStopped = false;

  constructor(lane: Lane, clock: Clock) {
    this.#lane = lane;
    this.#clock = clock;
  }

  publish(value: Uint8Array): void {
    if (this.#isStopped) {
      return;
    }
    this.#waiting = value;
    if (this.#callOff === undefined) {
      this.#flush();
    }
  }

  /** Discards the waiting value and all later ones. */
  stop(): void {
    this.#callOff?.();
    this.#isStopped = true;
    this.#waiting = undefined;
  }

  #flush(): void {
    this.#callOff = undefined;
    if (this.#waiting === undefined) {
      return;
    }
    if (this.#lane.buffered() > MOST_BUFFERED) {
      this.#callOff = this.#clock.after(LOOK_EVERY, () => this.#flush());
    } else {
      this.#lane.send(Kind.latestValue, this.#waiting);
      this.#waiting = undefined;
    }
  }
}
