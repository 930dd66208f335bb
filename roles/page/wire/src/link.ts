/** A link: four lanes that carry a protocol's values, frames, messages and blocks. */

import { rest } from "./codec.ts";
import type { LinkEnd } from "./errors.ts";
import type { Hasher } from "./frames.ts";
import { Frames, type Half, Latest, Messages } from "./halves.ts";
import { LANES, type LaneName, perLane } from "./handshake.ts";
import type { Rule } from "./inbox.ts";
import type { Clock, LaneEnd } from "./lane.ts";
import type { FramesLane, LatestLane, MessagesLane } from "./lanes.ts";
import type { Lanes } from "./meeting.ts";
import { Kind } from "./messages.ts";
import type { Protocol } from "./protocol.ts";

/** Bytes by direction, headers included. */
export interface Bytes {
  readonly sent: number;
  readonly received: number;
}

/** The link of a protocol: `LinkOf<typeof robot>`. */
export type LinkOf<P> =
  P extends Protocol<infer Hello, infer Value, infer Header, infer Items, infer Message>
    ? Link<Hello, Value, Header, Items, Message>
    : never;

/** The parts of a link, from `connect`. */
export interface LinkParts<Hello, Value, Header, Items, Message> {
  readonly protocol: Protocol<Hello, Value, Header, Items, Message>;
  readonly peer: Hello;
  readonly lanes: Lanes;
  readonly clock: Clock;
  readonly hashers: readonly [receiving: Hasher, sending: Hasher];
  readonly rule: Rule & { readonly maxItems: number };
}

/** How long the other lanes may take to close after the first, in milliseconds. */
const GRACE = 2_000;

/** A link to a peer, from `connect`. */
export class Link<Hello, Value, Header, Items, Message> {
  /** The peer's hello. */
  readonly peer: Hello;
  readonly latest: LatestLane<Value>;
  readonly frames: FramesLane<Header, Items>;
  readonly messages: MessagesLane<Message>;
  /** Large data, in blocks of at most 16,384 bytes. */
  readonly bulk: MessagesLane<Uint8Array>;
  /** Resolves once the link has ended, for whatever reason. It never rejects. */
  readonly closed: Promise<LinkEnd>;

  readonly #lanes: Lanes;
  readonly #halves: Readonly<Record<LaneName, Half>>;
  readonly #clock: Clock;
  readonly #maxUnread: number;
  #resolveClosed: (end: LinkEnd) => void = () => {};
  #peerClosed: LaneEnd | undefined;
  #callOffGrace: (() => void) | undefined;
  #isOver = false;

  /** For `connect`. */
  constructor(parts: LinkParts<Hello, Value, Header, Items, Message>) {
    const { protocol, peer, lanes, clock, hashers, rule } = parts;
    const { maxUnread } = rule;
    [this.peer, this.#lanes, this.#clock, this.#maxUnread] = [peer, lanes, clock, maxUnread];
    const latest = new Latest(lanes.latest, clock, protocol.latest, { maxUnread });
    const frames = new Frames(lanes.frames, clock, protocol, hashers, rule);
    const messages = new Messages(lanes.messages, clock, Kind.message, protocol.message, { maxUnread });
    const bulk = new Messages(lanes.bulk, clock, Kind.block, rest, { maxUnread });
    [this.latest, this.frames, this.messages, this.bulk] = [latest, frames, messages, bulk];
    this.#halves = { latest, frames, messages, bulk };
    this.closed = new Promise((resolve) => {
      this.#resolveClosed = resolve;
    });
    for (const name of LANES) {
      lanes[name].onEnd = (end) => this.#laneEnded(end);
    }
    for (const name of LANES) {
      lanes[name].listen((message) => {
        if (!this.#halves[name].take(message)) {
          const text = `more than ${this.#maxUnread} bytes wait for a reader on the ${name} lane`;
          this.#finish({ why: "overflow", text });
        }
      });
    }
  }

  /** Whether the link has ended. */
  get isOver(): boolean {
    return this.#isOver;
  }

  /** The bytes carried on each lane. */
  get bytes(): Readonly<Record<LaneName, Bytes>> {
    return perLane((name) => ({ ...this.#lanes[name].bytes }));
  }

  /**
   * Closes the link with a reason: one that just ends looks like a crash to the peer. The code is the
   * application's, and at most 200 bytes of the text are sent.
   */
  close(code = 0, text = ""): void {
    this.#finish({ why: "left", code, text });
  }

  /** When the peer closes, its earlier messages on the other lanes are still delivered. */
  #laneEnded(end: LaneEnd): void {
    if (end.why === "closed") {
      this.#peerClosed ??= end;
    }
    const closed = this.#peerClosed;
    if (closed === undefined || end.why === "violation") {
      this.#finish(end);
    } else if (LANES.every((name) => this.#lanes[name].isOver)) {
      this.#finish(closed);
    } else {
      this.#callOffGrace ??= this.#clock.after(GRACE, () => this.#finish(closed));
    }
  }

  #finish(end: LinkEnd): void {
    if (this.#isOver) {
      return;
    }
    this.#isOver = true;
    this.#callOffGrace?.();
    for (const name of LANES) {
      this.#lanes[name].leave(end.why === "left" ? end : undefined);
      this.#halves[name].end(end);
    }
    this.#resolveClosed(end);
  }
}
