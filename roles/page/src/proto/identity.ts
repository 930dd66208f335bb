/** The identity of a peer: the application's hello. And its close codes. */

import {
  defineProtocol,
  type Of,
  option,
  record,
  typedItems,
  u32,
  u64,
  u128,
  variant,
} from "trimaran-transport";
import { CAMERA } from "./camera.ts";
import { IdDecoder } from "./idCoding.ts";
import { ROLE_MESSAGE } from "./messages.ts";
import { SETTINGS } from "./settings.ts";

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

/** The protocol that peers of Trimaran's links must agree on. The items of a frame are ids. */
export const TRIMARAN = defineProtocol({
  name: "trimaran/4",
  hello: IDENTITY,
  latest: CAMERA,
  header: CAMERA,
  items: typedItems(Uint32Array),
  message: ROLE_MESSAGE,
  decoder: () => new IdDecoder(),
});

/** Why a peer closes a link. */
export const CloseCode = { finished: 0, interrupted: 1, failed: 2, deviceFailed: 4, replaced: 5 } as const;
