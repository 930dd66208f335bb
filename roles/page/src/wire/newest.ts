/** Sends values of the latest lane: each replaces the one before. */

import type { Clock, Lane } from "./lane.ts";
import { Kind } from "./messages.ts";

/** While more bytes than this wait to leave, only the newest value is kept. */
const MOST_BUFFERED = 4096;

/** How often it looks whether bytes have left, in milliseconds: a WebSocket does not say so itself. */
const LOOK_EVERY = 4;

/** Keeps the newest value where the lane is slower than values come. */
export class NewestSender {
  readonly #lane: Lane;
  readonly #clock: Clock;
  #waiting: Uint8Array | undefined;
  #callOff: (() => void) | undefined;

  constructor(lane: Lane, clock: Clock) {
    this.#lane = lane;
    this.#clock = clock;
  }

  publish(value: Uint8Array): void {
    this.#waiting = value;
    if (this.#callOff === undefined) {
      this.#flush();
    }
  }

  /** Forgets what waits. */
  stop(): void {
    this.#callOff?.();
    this.#callOff = undefined;
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
