/** How links end, and the errors about it. */

import type { Close, Refusal } from "./handshake.ts";
import type { LaneEnd } from "./lane.ts";

/** How a link ended: as one of its lanes, by this side's `close`, or because this side does not read. */
export type LinkEnd =
  | LaneEnd
  | ({ readonly why: "left" } & Close)
  | { readonly why: "overflow"; readonly text: string };

/**
 * The kind of an error:
 * - `unreachable`: no connection could be made;
 * - `timeout`: the listener did not answer in time;
 * - `refused`: the listener refused, see `refusal`;
 * - `rejected`: this side's `admit` did not take the listener;
 * - `closed`, `left`: the peer or this side has closed the link, see `close`;
 * - `lost`: the link ended without a close, or the peer has been silent for too long;
 * - `violation`: the peer broke the protocol;
 * - `overflow`: the peer sent more than `maxUnread` bytes that this side did not read.
 */
export type LinkErrorCode = "unreachable" | "timeout" | "refused" | "rejected" | LinkEnd["why"];

interface Details {
  readonly refusal?: Refusal;
  readonly close?: Close;
  readonly cause?: unknown;
}

/** There is no link, or not any more. */
export class LinkError extends Error {
  override name = "LinkError";
  readonly code: LinkErrorCode;
  /** The listener's reason, if it refused. */
  readonly refusal: Refusal | undefined;
  /** The reason of a close. */
  readonly close: Close | undefined;

  constructor(code: LinkErrorCode, text: string, { refusal, close, cause }: Details = {}) {
    super(text, cause === undefined ? undefined : { cause });
    [this.code, this.refusal, this.close] = [code, refusal, close];
  }
}

/** The error of whoever still waits on a link that has ended. */
export function errorOfEnd(end: LinkEnd): LinkError {
  switch (end.why) {
    case "closed":
      return new LinkError("closed", `the peer has closed the link: ${end.text}`, { close: end });
    case "left":
      return new LinkError("left", `this side has closed the link: ${end.text}`, { close: end });
    default:
      return new LinkError(end.why, end.text);
  }
}
