/** The identity of a peer: the application's hello. And its close codes. */

import { type Of, option, record, u32, u64, u128, variant, whole } from "../wire/codec.ts";
import type { Application } from "../wire/link.ts";
import { SETTINGS } from "./settings.ts";

/** The protocol that peers of Trimaran's links must agree on. */
export const TRIMARAN: Application = {
  name: "trimaran/3",
  format: { latest: 72, header: 72, item: 4 },
};

/** The scene, and how many records of each kind it has. */
const OUTLINE = record({
  /** The scene's fingerprint. */
  hash: u128,
  nodes: u32,
  /** The most ids that a frame can have. */
  drawables: u32,
  /** Pieces of geometry. */
  geometries: u32,
  objects: u32,
});

export type Outline = Of<typeof OUTLINE>;

const IDENTITY = record({
  role: variant(["culler", "display"]),
  /** The cooked scene that it holds. A display may hold none. */
  scene: option(OUTLINE),
  /** The session that a link is for: a random number of the display. None for a culler of any display. */
  session: option(record({ key: u64, settings: SETTINGS })),
});

export type Identity = Of<typeof IDENTITY>;

export const { encode: encodeIdentity, decode: decodeIdentity } = whole(IDENTITY);

/** Why a peer closes a link. */
export const CloseCode = { finished: 0, interrupted: 1, failed: 2, deviceFailed: 4, replaced: 5 } as const;
