/** A culler's report of its own work on a frame. */

import { type Of, option, record, u32, u64 } from "trimaran-transport";

/** Times are nanoseconds on the sender's clock. */
export const STATS = record({
  /** The display's number. */
  frame: u32,
  /** The frame whose visible set OR drew from. */
  occludersOf: option(u32),
  orStart: u64,
  orEnd: u64,
  orBusy: u64,
  hcStart: u64,
  hcEnd: u64,
  /** The device's times, nanoseconds on its own clock; 0 if not measured. */
  device: record({
    /** Drawing occluders. */
    drawing: u64,
    /** Building the depth pyramid. */
    pyramid: u64,
    /** Traversing the tree, for occluders and for visible nodes, or testing boxes. */
    culling: u64,
  }),
  occluders: u32,
  occluderTriangles: u64,
  /** Counters of the culling traversal. */
  culling: record({
    visited: u32,
    outside: u32,
    tested: u32,
    hidden: u32,
    nearVisible: u32,
    eyeInside: u32,
    notFinite: u32,
    fewPixels: u32,
    emitted: u32,
    refined: u32,
    batches: u32,
  }),
  /** The work after the first traversal. */
  furtherRounds: record({
    count: u32,
    occluderTriangles: u64,
    /** Nanoseconds. */
    drawing: u64,
    tested: u32,
    hidden: u32,
  }),
  /** Bytes by kind, and the number of messages. */
  toOtherCuller: record({
    camera: u64,
    begin: u64,
    ids: u64,
    end: u64,
    control: u64,
    geometry: u64,
    headers: u64,
    messages: u64,
  }),
});

export type Stats = Of<typeof STATS>;
