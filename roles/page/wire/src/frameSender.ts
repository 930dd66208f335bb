/** Sends frames, one after the other. */

import { Writer } from "./bytes.ts";
import { whole } from "./codec.ts";
import { type FrameProtocol, type Hasher, hashOf } from "./frames.ts";
import { Kind, MOST_ITEMS } from "./messages.ts";
import type { Outbox } from "./outbox.ts";
import type { Waiting } from "./waiter.ts";

/** A frame to send. */
export interface NewFrame<Header, Items> {
  /** Above those of all frames before. By default it is the next one. */
  readonly number?: number;
  readonly header: Header;
  readonly items: Items;
}

/** The most bytes of a batch, if an item is not larger. */
const MOST_PER_BATCH = 65_536;

/** The sending half of the frames lane. */
export class FrameSender<Header, Items> {
  readonly #outbox: Outbox;
  readonly #hasher: Hasher;
  readonly #protocol: FrameProtocol<Header, Items>;
  #next = 0;
  #turn: Promise<unknown> = Promise.resolve();

  constructor(outbox: Outbox, hasher: Hasher, protocol: FrameProtocol<Header, Items>) {
    [this.#outbox, this.#hasher, this.#protocol] = [outbox, hasher, protocol];
  }

  /** Sends a frame after those before it, and returns its number. */
  send(frame: NewFrame<Header, Items>, options: Waiting = {}): Promise<number> {
    const sent = this.#turn.then(() => this.#send(frame, options));
    this.#turn = sent.catch(() => {});
    return sent;
  }

  async #send(frame: NewFrame<Header, Items>, { signal }: Waiting): Promise<number> {
    signal?.throwIfAborted();
    const { number = this.#next } = frame;
    if (!(number >= this.#next && number <= 0xffff_ffff && Number.isInteger(number))) {
      throw new RangeError(`frame ${number} cannot be sent: the next number is ${this.#next}`);
    }
    const { header, items } = this.#protocol;
    const bytes = items.encode(frame.items);
    const begin = new Writer().u32(number).bytes(whole(header).encode(frame.header)).take();
    const step = items.size * Math.min(MOST_ITEMS, Math.max(1, Math.floor(MOST_PER_BATCH / items.size)));
    await this.#outbox.send(Kind.begin, begin);
    this.#next = number + 1;
    this.#hasher.init();
    // An aborted frame ends all the same. The peer sees that items are missing.
    let from = 0;
    for (; from < bytes.length && signal?.aborted !== true; from += step) {
      const batch = bytes.subarray(from, from + step);
      this.#hasher.update(batch);
      await this.#outbox.send(Kind.batch, batch);
    }
    const end = new Writer().u32(number).u32(bytes.length / items.size);
    await this.#outbox.send(Kind.end, end.u64(hashOf(this.#hasher)).take());
    if (from < bytes.length) {
      signal?.throwIfAborted();
    }
    return number;
  }
}
