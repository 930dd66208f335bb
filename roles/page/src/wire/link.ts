/** A link to a listening peer: four lanes that identify themselves, and then carry the peers' messages. */

import { randomNumber, WireError } from "./bytes.ts";
import { type BatchDecoder, type Frame, FrameAssembler, loadHasher } from "./frames.ts";
import { type Close, CODE_NOT_TAKEN, LANES, type LaneName, perLane } from "./handshake.ts";
import { type Channel, type Clock, type Lane, type LaneEnd, systemClock } from "./lane.ts";
import { type Lanes, LinkError, meet } from "./meeting.ts";
import { type Format, Kind, type Message, nameOfKind } from "./messages.ts";
import { NewestSender } from "./newest.ts";
import { openWebSocket } from "./websocket.ts";

/** The protocol that both peers of a link must agree on. */
export interface Application {
  /** The name of the protocol with its version, at most 32 bytes. */
  readonly name: string;
  readonly format: Format;
}

/** This side's judgement of the listener's introduction. */
export type Admission =
  | { readonly isTaken: true; readonly mostIds: number; readonly decoder?: BatchDecoder }
  | { readonly isTaken: false; readonly why: string };

/** Callbacks for arrivals. If one throws a `WireError`, the peer has violated the protocol. */
export interface LinkHandlers {
  onFrame(frame: Frame): void;
  onMessage(payload: Uint8Array): void;
  onBlock(payload: Uint8Array): void;
  onValue?(payload: Uint8Array): void;
  /** Called once, also if this side leaves. */
  onEnd(end: LinkEnd): void;
}

/** How a link ended. */
export type LinkEnd = LaneEnd | ({ readonly why: "left" } & Close);

export interface LinkOptions {
  readonly application: Application;
  readonly handlers: LinkHandlers;
  /** Decides on the listener. Throws a `WireError` for an unreadable introduction. */
  admit(introduction: Uint8Array): Admission;
  /** Opens the connection of a lane. */
  readonly open?: (url: string, lane: LaneName) => Promise<Channel>;
  readonly clock?: Clock;
  /** The number that pairs the connections, instead of a random one. */
  readonly session?: bigint;
}

/** Bytes by direction, headers included. */
export interface Bytes {
  readonly sent: number;
  readonly received: number;
}

/**
 * Connects to a listener and introduces this side to it.
 *
 * Throws a `LinkError` if no link can be made.
 */
export async function connect(url: string, introduction: Uint8Array, options: LinkOptions): Promise<Link> {
  const { application, clock = systemClock } = options;
  const open = options.open ?? ((url: string) => openWebSocket(url));
  const session = options.session ?? randomNumber();
  const lane = { format: application.format, clock };
  const hello = { application: application.name, session, introduction };
  const hasher = await loadHasher();
  const { lanes, listener } = await meet((name) => open(url, name), hello, lane);
  const admission = judge(listener, options);
  if (!admission.isTaken) {
    for (const name of LANES) {
      lanes[name].leave({ code: CODE_NOT_TAKEN, text: admission.why });
    }
    throw new LinkError(admission.why);
  }
  const frames = new FrameAssembler(hasher, admission.mostIds, admission.decoder);
  return new Link(listener, lanes, frames, options.handlers, clock);
}

/** How long the other lanes may take to close after the first, in milliseconds. */
const GRACE = 2_000;

/** Four lanes after a successful handshake. */
export class Link {
  /** The listener's introduction. */
  readonly listener: Uint8Array;
  readonly #lanes: Lanes;
  readonly #frames: FrameAssembler;
  readonly #handlers: LinkHandlers;
  readonly #newest: NewestSender;
  readonly #clock: Clock;
  #closed: LaneEnd | undefined;
  #callOffGrace: (() => void) | undefined;
  isOver = false;

  /** For `connect`. */
  constructor(
    listener: Uint8Array,
    lanes: Lanes,
    frames: FrameAssembler,
    handlers: LinkHandlers,
    clock: Clock,
  ) {
    [this.listener, this.#lanes, this.#frames] = [listener, lanes, frames];
    [this.#handlers, this.#clock] = [handlers, clock];
    this.#newest = new NewestSender(lanes.latest, clock);
    for (const name of LANES) {
      lanes[name].onEnd = (end) => this.#laneEnded(end);
    }
    // Earlier arrivals are delivered once the caller of `connect` has the link.
    clock.after(0, () => {
      for (const name of LANES) {
        lanes[name].listen((message) => this.#take(lanes[name], message));
      }
    });
  }

  /** The bytes carried on each lane. */
  get bytes(): Readonly<Record<LaneName, Bytes>> {
    return perLane((name) => ({ ...this.#lanes[name].bytes }));
  }

  /** Sends a value of the latest lane, unless a newer one replaces it first. */
  publish(value: Uint8Array): void {
    this.#newest.publish(value);
  }

  sendMessage(payload: Uint8Array): void {
    this.#lanes.messages.send(Kind.message, payload);
  }

  sendBlock(payload: Uint8Array): void {
    this.#lanes.bulk.send(Kind.block, payload);
  }

  /** Closes the link. The code is the application's, and at most 200 bytes of the text are sent. */
  close(code: number, text: string): void {
    this.#finish({ why: "left", code, text });
  }

  #take({ name }: Lane, { kind, payload }: Message): void {
    if (kind === Kind.latestValue && name === "latest") {
      this.#handlers.onValue?.(payload);
    } else if (kind === Kind.message && name === "messages") {
      this.#handlers.onMessage(payload);
    } else if (kind === Kind.block && name === "bulk") {
      this.#handlers.onBlock(payload);
    } else if (name === "frames") {
      const frame = this.#frames.take({ kind, payload });
      if (frame !== undefined) {
        this.#handlers.onFrame(frame);
      }
    } else {
      throw new WireError(`a ${nameOfKind(kind)} came, which does not belong there`);
    }
  }

  /** When the peer closes, its earlier messages on the other lanes are still delivered. */
  #laneEnded(end: LaneEnd): void {
    if (end.why === "closed") {
      this.#closed ??= end;
    }
    const closed = this.#closed;
    if (closed === undefined || end.why === "violation") {
      this.#finish(end);
    } else if (LANES.every((name) => this.#lanes[name].isOver)) {
      this.#finish(closed);
    } else {
      this.#callOffGrace ??= this.#clock.after(GRACE, () => this.#finish(closed));
    }
  }

  #finish(end: LinkEnd): void {
    if (this.isOver) {
      return;
    }
    this.isOver = true;
    this.#newest.stop();
    this.#callOffGrace?.();
    for (const name of LANES) {
      this.#lanes[name].leave(end.why === "left" ? end : undefined);
    }
    this.#handlers.onEnd(end);
  }
}

function judge(listener: Uint8Array, options: LinkOptions): Admission {
  try {
    return options.admit(listener);
  } catch (error) {
    if (error instanceof WireError) {
      return { isTaken: false, why: `who listens cannot be understood: ${error.message}` };
    }
    throw error;
  }
}
