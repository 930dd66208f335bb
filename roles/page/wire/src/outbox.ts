/** The sending half of a lane: what is sent is queued at once, and the sender waits for room. */

import { errorOfEnd, type LinkEnd } from "./errors.ts";
import type { Clock, Lane } from "./lane.ts";
import type { Kind } from "./messages.ts";
import { Waiter, type Waiting } from "./waiter.ts";

/** Beyond this many unsent bytes a sender waits. */
const MOST_UNSENT = 262_144;

/** The polling interval for unsent bytes, milliseconds: a WebSocket has no event for it. */
const LOOK_EVERY = 4;

/** The outbox of one lane. */
export class Outbox {
  readonly #lane: Lane;
  readonly #clock: Clock;
  readonly #senders = new Set<Waiter<void>>();
  #callOff: (() => void) | undefined;
  #end: LinkEnd | undefined;

  constructor(lane: Lane, clock: Clock) {
    [this.#lane, this.#clock] = [lane, clock];
  }

  /**
   * Sends a message at once. Resolves when there is room for another one.
   *
   * Nobody needs to wait for that: an error that nobody awaits is no unhandled one.
   */
  send(kind: Kind, payload: Uint8Array, options: Waiting = {}): Promise<void> {
    const room = this.#send(kind, payload, options);
    room.catch(() => {});
    return room;
  }

  end(end: LinkEnd): void {
    this.#end = end;
    this.#callOff?.();
    for (const sender of this.#senders) {
      sender.reject(errorOfEnd(end));
    }
  }

  async #send(kind: Kind, payload: Uint8Array, options: Waiting): Promise<void> {
    options.signal?.throwIfAborted();
    if (this.#end !== undefined) {
      throw errorOfEnd(this.#end);
    }
    this.#lane.send(kind, payload);
    const sender = new Waiter(this.#senders, options);
    this.#look();
    return sender.promise;
  }

  #look(): void {
    if (this.#lane.buffered() <= MOST_UNSENT) {
      for (const sender of this.#senders) {
        sender.resolve();
      }
    } else {
      this.#callOff ??= this.#clock.after(LOOK_EVERY, () => {
        this.#callOff = undefined;
        this.#look();
      });
    }
  }
}
