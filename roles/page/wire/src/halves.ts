/** The work of the lanes of a link: they decode arrivals, and encode what is sent. */

import { WireError } from "./bytes.ts";
import { type Codec, whole } from "./codec.ts";
import type { LinkEnd } from "./errors.ts";
import { FrameSender, type NewFrame } from "./frameSender.ts";
import { type Frame, FrameAssembler, type FrameProtocol, type Hashers } from "./frames.ts";
import { Inbox, type Rule } from "./inbox.ts";
import type { Clock, Lane } from "./lane.ts";
import type { FramesLane, LatestLane, MessagesLane } from "./lanes.ts";
import { Kind, type Message, nameOfKind } from "./messages.ts";
import { NewestSender } from "./newest.ts";
import { Outbox } from "./outbox.ts";
import type { Waiting } from "./waiter.ts";

/** A lane as its link sees it. */
export interface Half {
  /** Takes an arrival. Returns false if nobody reads and there is no room for it. */
  take(message: Message): boolean;
  end(end: LinkEnd): void;
}

/** The latest lane. */
export class Latest<T> extends Inbox<T> implements Half, LatestLane<T> {
  readonly #newest: NewestSender;
  readonly #value: ReturnType<typeof whole<T>>;

  constructor(lane: Lane, clock: Clock, value: Codec<T>, rule: Rule) {
    super({ ...rule, keep: 1 });
    [this.#newest, this.#value] = [new NewestSender(lane, clock), whole(value)];
  }

  publish(value: T): void {
    this.#newest.publish(this.#value.encode(value));
  }

  take({ kind, payload }: Message): boolean {
    expect(kind, Kind.latestValue);
    return this.push(this.#value.decode(payload), payload.length);
  }

  override end(end: LinkEnd): void {
    this.#newest.stop();
    super.end(end);
  }
}

/** The frames lane. */
export class Frames<Header, Items>
  extends Inbox<Frame<Header, Items>>
  implements Half, FramesLane<Header, Items>
{
  readonly #assembler: FrameAssembler<Header, Items>;
  readonly #outbox: Outbox;
  readonly #sender: FrameSender<Header, Items>;
  #bytes = 0;

  constructor(
    lane: Lane,
    clock: Clock,
    protocol: FrameProtocol<Header, Items>,
    hashers: Hashers,
    rule: Rule & { readonly maxItems: number },
  ) {
    super(rule);
    this.#assembler = new FrameAssembler(hashers[0], protocol, rule.maxItems);
    this.#outbox = new Outbox(lane, clock);
    this.#sender = new FrameSender(this.#outbox, hashers[1], protocol);
  }

  send(frame: NewFrame<Header, Items>, options?: Waiting): Promise<number> {
    return this.#sender.send(frame, options);
  }

  take(message: Message): boolean {
    this.#bytes += message.payload.length;
    const frame = this.#assembler.take(message);
    if (message.kind !== Kind.end) {
      return true;
    }
    const bytes = this.#bytes;
    this.#bytes = 0;
    return frame === undefined || this.push(frame, bytes);
  }

  override end(end: LinkEnd): void {
    this.#outbox.end(end);
    super.end(end);
  }
}

/** The messages lane, or the bulk lane: `kind` says which. */
export class Messages<T> extends Inbox<T> implements Half, MessagesLane<T> {
  readonly #outbox: Outbox;
  readonly #kind: Kind;
  readonly #message: ReturnType<typeof whole<T>>;

  constructor(lane: Lane, clock: Clock, kind: Kind, message: Codec<T>, rule: Rule) {
    super(rule);
    [this.#outbox, this.#kind, this.#message] = [new Outbox(lane, clock), kind, whole(message)];
  }

  send(message: T, options?: Waiting): Promise<void> {
    return this.#outbox.send(this.#kind, this.#message.encode(message), options);
  }

  take({ kind, payload }: Message): boolean {
    expect(kind, this.#kind);
    return this.push(this.#message.decode(payload), payload.length);
  }

  override end(end: LinkEnd): void {
    this.#outbox.end(end);
    super.end(end);
  }
}

function expect(kind: Kind, expected: Kind): void {
  if (kind !== expected) {
    throw new WireError(`a ${nameOfKind(kind)} came, which does not belong there`);
  }
}
