/** A link: four lanes that carry a protocol's values, frames, messages and blocks, and its channels. */

import type { ChannelLanes, Channels, NoChannels } from "./channels.ts";
import { rest } from "./codec.ts";
import type { LinkEnd } from "./errors.ts";
import type { Hashers } from "./frames.ts";
import { Frames, type Half, Latest, Messages } from "./halves.ts";
import { type LaneName, perLane } from "./handshake.ts";
import type { Rule } from "./inbox.ts";
import type { Clock, Lane, LaneEnd } from "./lane.ts";
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
  P extends Protocol<infer Hello, infer Value, infer Header, infer Items, infer Message, infer C>
    ? Link<Hello, Value, Header, Items, Message, C>
    : never;

/** The parts of a link, from `connect`. */
export interface LinkParts<Hello, Value, Header, Items, Message, C extends Channels> {
  readonly protocol: Protocol<Hello, Value, Header, Items, Message, C>;
  readonly peer: Hello;
  readonly lanes: Lanes;
  /** In the order of the protocol. */
  readonly channels: readonly Lane[];
  readonly clock: Clock;
  /** Of the frames lane, and of each channel. */
  readonly hashers: readonly Hashers[];
  readonly rule: Rule & { readonly maxItems: number };
}

/** How long the other lanes may take to close after the first, in milliseconds. */
const GRACE = 2_000;

/** A link to a peer, from `connect`. */
export class Link<Hello, Value, Header, Items, Message, C extends Channels = NoChannels> {
  /** The peer's hello. */
  readonly peer: Hello;
  readonly latest: LatestLane<Value>;
  readonly frames: FramesLane<Header, Items>;
  readonly messages: MessagesLane<Message>;
  /** Large data, in blocks of at most 16,384 bytes. */
  readonly bulk: MessagesLane<Uint8Array>;
  /** Further lanes by name, as the protocol declares them. */
  readonly channels: ChannelLanes<C>;
  /** Resolves once the link has ended, for whatever reason. It never rejects. */
  readonly closed: Promise<LinkEnd>;

  readonly #lanes: Lanes;
  readonly #channels: readonly (readonly [name: string, lane: Lane])[];
  readonly #all: readonly (readonly [lane: Lane, half: Half])[];
  readonly #clock: Clock;
  readonly #maxUnread: number;
  #resolveClosed: (end: LinkEnd) => void = () => {};
  #peerClosed: LaneEnd | undefined;
  #callOffGrace: (() => void) | undefined;
  #isOver = false;

  /** For `connect`. */
  constructor(parts: LinkParts<Hello, Value, Header, Items, Message, C>) {
    const { protocol, peer, lanes, clock, hashers, rule } = parts;
    const { maxUnread } = rule;
    [this.peer, this.#lanes, this.#clock, this.#maxUnread] = [peer, lanes, clock, maxUnread];
    const latest = new Latest(lanes.latest, clock, protocol.latest, { maxUnread });
    const [ofFrames, ...ofChannels] = hashers as [Hashers, ...Hashers[]];
    const frames = new Frames(lanes.frames, clock, protocol, ofFrames, rule);
    const messages = new Messages(lanes.messages, clock, Kind.message, protocol.message, { maxUnread });
    const bulk = new Messages(lanes.bulk, clock, Kind.block, rest, { maxUnread });
    [this.latest, this.frames, this.messages, this.bulk] = [latest, frames, messages, bulk];
    const channels = Object.entries(protocol.channels).map(([name, channel], at) => {
      const lane = parts.channels[at] as Lane;
      const half =
        "latest" in channel
          ? new Latest(lane, clock, channel.latest, { maxUnread })
          : new Frames(lane, clock, channel, ofChannels[at] as Hashers, rule);
      return { name, lane, half };
    });
    this.channels = Object.fromEntries(
      channels.map(({ name, half }) => [name, half]),
    ) as unknown as ChannelLanes<C>;
    this.#channels = channels.map(({ name, lane }) => [name, lane]);
    this.#all = [
      [lanes.latest, latest],
      [lanes.frames, frames],
      [lanes.messages, messages],
      [lanes.bulk, bulk],
      ...channels.map(({ lane, half }) => [lane, half] as const),
    ];
    this.closed = new Promise((resolve) => {
      this.#resolveClosed = resolve;
    });
    for (const [lane] of this.#all) {
      lane.onEnd = (end) => this.#laneEnded(end);
    }
    for (const [lane, half] of this.#all) {
      lane.listen((message) => {
        if (!half.take(message)) {
          const text = `more than ${this.#maxUnread} bytes wait for a reader on the ${lane.title}`;
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

  /** The bytes carried on each channel. */
  get channelBytes(): Readonly<Record<keyof C, Bytes>> {
    const bytes = this.#channels.map(([name, lane]) => [name, { ...lane.bytes }]);
    return Object.fromEntries(bytes) as Record<keyof C, Bytes>;
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
    } else if (this.#all.every(([lane]) => lane.isOver)) {
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
    for (const [lane, half] of this.#all) {
      lane.leave(end.why === "left" ? end : undefined);
      half.end(end);
    }
    this.#resolveClosed(end);
  }
}
