/** What the renderer needs of what the wire brings. */

import type { Camera as WireCamera } from "../proto/camera.ts";
import { ObjectSet } from "../proto/objectSet.ts";
import type { Piece } from "../proto/piece.ts";
import type { DrawableRecord } from "../proto/records.ts";
import type { Section } from "../proto/viewState.ts";

/** The triangles of a piece of geometry. */
export type Mesh = Pick<Piece, "vertices" | "indices">;

/** A piece of geometry at its place in the world. It is drawn in the order of its box. */
export type Drawable = Pick<
  DrawableRecord,
  "id" | "object" | "objects" | "geometry" | "origin" | "linear" | "sides" | "worldMin" | "worldMax"
>;

/** What of the objects is drawn otherwise than it is. */
export interface Look {
  /** What they cut away is not drawn. */
  readonly sections: readonly Section[];
  /** They are drawn in another colour. */
  readonly highlighted: ObjectSet;
  /** The rest shines through them. */
  readonly seeThrough: ObjectSet;
}

/** All objects as they are. */
export const PLAIN: Look = { sections: [], highlighted: ObjectSet.EMPTY, seeThrough: ObjectSet.EMPTY };

/** Where the picture is seen from. */
export type Camera = Pick<WireCamera, "eye" | "orientation" | "tanHalfFov" | "near">;
