/** Arrivals that wait for a reader. */

import { errorOfEnd, type LinkEnd } from "./errors.ts";
import { Waiter, type Waiting } from "./waiter.ts";

/**
 * The receiving half of a lane.
 *
 * `for await` takes what arrives, in order, until either side closes the link. It throws a `LinkError` if the
 * link fails. A loop may be left and another one begun: nothing is lost.
 */
export interface Receiver<T> extends AsyncIterable<T, undefined, undefined> {
  /** How many were left out because newer ones came. */
  readonly skipped: number;
  /** The next one. Rejects with a `LinkError` if the link has ended, and loses nothing if it is aborted. */
  receive(options?: Waiting): Promise<T>;
}

/** The limits of arrivals that nobody has read. */
export interface Rule {
  /** Only this many are kept, the newest ones. */
  readonly keep?: number | undefined;
  /** They may have this many bytes. */
  readonly maxUnread: number;
}

/** A receiver, and what its link calls. */
export class Inbox<T> implements Receiver<T> {
  skipped = 0;
  readonly #rule: Rule;
  readonly #unread: { readonly item: T; readonly size: number }[] = [];
  #bytes = 0;
  readonly #takers = new Set<Waiter<T>>();
  #end: LinkEnd | undefined;

  constructor(rule: Rule) {
    this.#rule = rule;
  }

  /** Takes an arrival of this many bytes. Returns false if there is no room for it. */
  push(item: T, size: number): boolean {
    const [taker] = this.#takers;
    if (taker !== undefined) {
      taker.resolve(item);
      return true;
    }
    const { keep = Number.POSITIVE_INFINITY, maxUnread } = this.#rule;
    this.#unread.push({ item, size });
    this.#bytes += size;
    while (this.#unread.length > keep) {
      this.#shift();
      this.skipped += 1;
    }
    return this.#bytes <= maxUnread;
  }

  /** Nothing comes any more. Messages that have come can still be read, unless this side has left. */
  end(end: LinkEnd): void {
    this.#end = end;
    if (end.why === "left") {
      this.#unread.length = 0;
    }
    for (const taker of this.#takers) {
      taker.reject(errorOfEnd(end));
    }
  }

  async receive(options: Waiting = {}): Promise<T> {
    options.signal?.throwIfAborted();
    if (this.#unread.length > 0) {
      return this.#shift();
    }
    if (this.#end !== undefined) {
      throw errorOfEnd(this.#end);
    }
    return new Waiter(this.#takers, options).promise;
  }

  async *[Symbol.asyncIterator](): AsyncGenerator<T, undefined, undefined> {
    for (;;) {
      let item: T;
      try {
        item = await this.receive();
      } catch (error) {
        if (this.#end?.why === "closed" || this.#end?.why === "left") {
          return undefined;
        }
        throw error;
      }
      yield item;
    }
  }

  #shift(): T {
    const [{ item, size }] = this.#unread.splice(0, 1) as [{ item: T; size: number }];
    this.#bytes -= size;
    return item;
  }
}
