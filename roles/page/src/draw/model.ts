/** The renderer's input, from the wire's types. */

import type { Camera as WireCamera } from "../proto/camera.ts";
import { ObjectSet } from "../proto/objectSet.ts";
import type { Piece } from "../proto/piece.ts";
import type { DrawableRecord } from "../proto/records.ts";
import type { Section } from "../proto/viewState.ts";
import type { ObjectColours } from "./colours.ts";

/** The triangles of a piece of geometry. */
export type Mesh = Pick<Piece, "vertices" | "indices">;

/** The triangles of a piece of geometry, in its local frame. */
export interface Triangles {
  /** Three numbers per vertex. */
  readonly positions: Float32Array;
  /** Three indices per triangle. */
  readonly indices: Uint32Array;
}

/** A piece of geometry at its place in the world. The drawing order follows its box. */
export type Drawable = Pick<
  DrawableRecord,
  "id" | "object" | "objects" | "geometry" | "origin" | "linear" | "sides" | "worldMin" | "worldMax"
>;

/** How the picture differs from the plain model. */
export interface Look {
  /** The parts outside these are not drawn. */
  readonly sections: readonly Section[];
  /** Drawn in another colour. */
  readonly highlighted: ObjectSet;
  /** Colours in place of those of the model. */
  readonly colours?: ObjectColours | undefined;
  /** Drawn see-through. */
  readonly seeThrough: ObjectSet;
  /** They are ghosts: fainter, since many lie one behind the other, and without lines. */
  readonly areGhosts?: boolean;
}

/** The plain model. */
export const PLAIN: Look = { sections: [], highlighted: ObjectSet.EMPTY, seeThrough: ObjectSet.EMPTY };

/** The viewpoint of a picture. */
export type Camera = Pick<WireCamera, "eye" | "orientation" | "tanHalfFov" | "near">;
