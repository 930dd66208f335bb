/** What the renderer is told: meshes, drawables and cameras. What the wire brings is of these forms. */

/** Bytes of a vertex: position (3 f32), sRGB colour (4 u8), folded normal (2 i16). */
export const VERTEX_BYTES = 20;

/** The triangles of a piece of geometry. */
export interface Mesh {
  /** 20 bytes each. The position is about the origin of the node, before its matrix. */
  readonly vertices: Uint8Array<ArrayBuffer>;
  /** Three a triangle, counter-clockwise from its front. The first carries its colour and normal. */
  readonly indices: Uint32Array<ArrayBuffer>;
}

/** A piece of geometry at its place in the world. */
export interface Drawable {
  readonly id: number;
  /** An object that it shows. */
  readonly object: number;
  /** The number of its piece of geometry. */
  readonly geometry: number;
  /** Origin of its local frame in the world, metres, as doubles. */
  readonly origin: readonly [number, number, number];
  /** Local frame to world without the translation: nine numbers, column by column. */
  readonly linear: ArrayLike<number>;
  /** 0 if both sides of its triangles can show, 1 if only the front can. */
  readonly sides: number;
  /** Lower and upper corner of its node's box in the world, metres. It is drawn in the order of these. */
  readonly worldMin: readonly [number, number, number];
  readonly worldMax: readonly [number, number, number];
}

/** Where the picture is seen from. The world is right-handed, in metres. */
export interface Camera {
  readonly eye: readonly [number, number, number];
  /** Camera to world: a unit quaternion x, y, z, w. Camera space has x right, y up, and looks down -z. */
  readonly orientation: readonly [number, number, number, number];
  /** Tangent of half the vertical field of view. */
  readonly tanHalfFov: number;
  /** Near distance in metres. There is no far one. */
  readonly near: number;
}
