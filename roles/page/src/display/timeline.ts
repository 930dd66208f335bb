/** The division of a frame's time, for the newest frames. */

import type { Stats } from "../proto/stats.ts";

/** The most frames that are kept. */
const MOST = 64;

/** The times of passes on a culler's device, milliseconds; 0 if not measured. */
export interface PassTimes {
  readonly occluders: number;
  readonly pyramid: number;
  readonly culling: number;
}

/** Milliseconds, by `performance.now()`. */
export interface FrameTimes {
  readonly frame: number;
  /** When its camera was published. */
  readonly posed: number;
  /** When all its ids had arrived. */
  readonly came: number;
  /** How long the culler drew occluders and tested boxes; nothing until it has reported. */
  work: { readonly or: number; readonly hc: number; readonly onDevice: PassTimes } | undefined;
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
  said({ frame, orBusy, hcStart, hcEnd, device }: Stats): void {
    const times = this.frames.find((one) => one.frame === frame);
    if (times !== undefined) {
      const [occluders, pyramid] = [milliseconds(device.drawing), milliseconds(device.pyramid)];
      const onDevice = { occluders, pyramid, culling: milliseconds(device.culling) };
      times.work = { or: milliseconds(orBusy), hc: milliseconds(hcEnd - hcStart), onDevice };
    }
  }
}

function milliseconds(nanoseconds: bigint): number {
  return Math.max(0, Number(nanoseconds) / 1e6);
}
