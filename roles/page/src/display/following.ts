/** Following another display: tells the leader's frames from the display's own. */

import { type Frame, WireError } from "trimaran-transport";
import type { Camera } from "../proto/camera.ts";
import type { RoleMessage } from "../proto/messages.ts";
import { decodeViewState, MOST_BYTES, type ViewState } from "../proto/viewState.ts";

/** A frame of ids as it comes. */
type IdFrame = Frame<Camera, Uint32Array>;

/** A frame, and the leader's view state if it is not the display's own. */
export interface Sorted {
  readonly frame: IdFrame;
  readonly led: ViewState | undefined;
}

/** Frames of one origin: from this number on, until the next span. */
interface Span {
  readonly first: number;
  readonly isLed: boolean;
}

/** Frames kept while it is not known whose they are, or in which view state. */
const KEPT = 4;
/** Changes of the leader that are kept. */
const SPANS = 8;
/** Versions of the leader's view state that are kept. */
const VERSIONS = 4;

export class Following {
  /** The display that this one wants to follow. */
  #wanted: bigint | undefined;
  /** The answer that is still to come. */
  #awaited: { readonly leader: bigint; readonly isFollow: boolean } | undefined;
  /** From which frame on they are a leader's, or the display's own: the last few changes, the newest last. */
  readonly #spans: Span[] = [{ first: 0, isLed: false }];
  /** The span of the leader whose view states are known. */
  #viewed: Span | undefined;
  #parts: Uint8Array[] = [];
  #bytes = 0;
  readonly #views = new Map<number, ViewState>();
  #kept: IdFrame[] = [];

  /** Whether the display follows, or waits for the answer to a request: it sends no cameras then. */
  get isAway(): boolean {
    return this.#wanted !== undefined || this.#awaited !== undefined || this.#span().isLed;
  }

  get leader(): bigint | undefined {
    return this.#wanted;
  }

  /** Follows a display, or none any more. Returns the message to send, if any. */
  follow(leader: bigint | undefined): RoleMessage | undefined {
    const before = this.#wanted;
    if (leader === before) {
      return undefined;
    }
    this.#wanted = leader;
    const named = leader ?? before;
    if (named === undefined) {
      return undefined;
    }
    this.#awaited = { leader: named, isFollow: leader !== undefined };
    return { what: leader === undefined ? "unfollow" : "follow", leader: named };
  }

  /** Takes a message of the culler. Returns whether it was about following. */
  hear(message: RoleMessage): boolean {
    switch (message.what) {
      case "followed":
        this.#answer(message.leader, true, message.firstFrame);
        return true;
      case "unfollowed":
        if (this.#wanted === message.leader) {
          this.#wanted = undefined;
        }
        this.#answer(message.leader, false, message.firstFrame);
        return true;
      case "view":
        this.#takeView(message);
        return true;
      default:
        return false;
    }
  }

  /** Takes a frame, or nothing new. Returns the frames whose owner and view state are known, in order. */
  sort(frame?: IdFrame): Sorted[] {
    if (frame !== undefined) {
      this.#kept.push(frame);
      if (this.#kept.length > KEPT) {
        this.#kept.shift();
      }
    }
    if (this.#awaited !== undefined) {
      return [];
    }
    const kept: IdFrame[] = [];
    const sorted: Sorted[] = [];
    for (const each of this.#kept) {
      const span = this.#span(each.number);
      const led = span === this.#viewed ? this.#views.get(each.header.viewState) : undefined;
      if (!span.isLed || led !== undefined) {
        sorted.push({ frame: each, led });
      } else if (span === this.#span()) {
        kept.push(each);
      }
    }
    this.#kept = kept;
    return sorted;
  }

  /** The span of a frame, or the newest one. */
  #span(frame = Number.POSITIVE_INFINITY): Span {
    const found = [...this.#spans].reverse().find(({ first }) => first <= frame);
    return found ?? { first: 0, isLed: false };
  }

  #answer(leader: bigint, isFollow: boolean, first: number): void {
    const span = { first, isLed: isFollow };
    this.#spans.push(span);
    if (this.#spans.length > SPANS) {
      this.#spans.shift();
    }
    if (isFollow) {
      this.#viewed = span;
      this.#views.clear();
      [this.#parts, this.#bytes] = [[], 0];
    }
    const awaited = this.#awaited;
    // Nobody leads: that answers a request to follow as well.
    if (awaited?.leader === leader && (awaited.isFollow === isFollow || !isFollow)) {
      this.#awaited = undefined;
    }
  }

  #takeView({ version, part, isLast }: Extract<RoleMessage, { what: "view" }>): void {
    this.#parts.push(part);
    this.#bytes += part.length;
    if (this.#bytes > MOST_BYTES) {
      throw new WireError(`a view state of more than ${MOST_BYTES} bytes`);
    }
    if (isLast) {
      const bytes = new Uint8Array(this.#bytes);
      let at = 0;
      for (const each of this.#parts) {
        bytes.set(each, at);
        at += each.length;
      }
      const state = decodeViewState(bytes);
      [this.#parts, this.#bytes] = [[], 0];
      this.#views.delete(version);
      this.#views.set(version, state);
      for (const oldest of this.#views.keys()) {
        if (this.#views.size <= VERSIONS) {
          break;
        }
        this.#views.delete(oldest);
      }
    }
  }
}
