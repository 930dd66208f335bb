/** The division of a frame's time, for the newest frames. */

import type { Stats } from "../proto/stats.ts";

/** The most frames that are kept. */
const MOST = 64;

/** Milliseconds, by `performance.now()`. */
export interface FrameTimes {
  readonly frame: number;
  /** When its camera was published. */
  readonly posed: number;
  /** When all its ids had arrived. */
  readonly came: number;
  /** How long the culler drew occluders and tested boxes; nothing until it has reported. */
  work: { readonly or: number; readonly hc: number } | undefined;
}

export class Timeline {
  /** From the oldest to the newest. */
  readonly frames: FrameTimes[] = [];

  /** A set has arrived. */
  came(frame: number, posed: number, came: number): void {
    this.frames.push({ frame, posed, came, work: undefined });
    this.frames.splice(0, this.frames.length - MOST);
  }

  /** A culler's report of its work on a frame. It follows the frame. */
  said({ frame, orBusy, hcStart, hcEnd }: Stats): void {
    const times = this.frames.find((one) => one.frame === frame);
    if (times !== undefined) {
      times.work = { or: milliseconds(orBusy), hc: milliseconds(hcEnd - hcStart) };
    }
  }
}

function milliseconds(nanoseconds: bigint): number {
  return Math.max(0, Number(nanoseconds) / 1e6);
}
