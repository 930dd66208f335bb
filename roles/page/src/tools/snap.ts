/** Snaps the pointer to a vertex, an edge, or a face. */

import type { Drawable } from "../draw/model.ts";
import type { Point } from "../proto/viewState.ts";
import { lerp, type Place, type Projection } from "./projection.ts";

/** The triangles of a piece of geometry, in its local frame. */
export interface Triangles {
  /** Three numbers per vertex. */
  readonly positions: Float32Array;
  /** Three indices per triangle. */
  readonly indices: Uint32Array;
}

/** A point of the model's surface. */
export interface End {
  readonly point: Point;
  /** Its distance from the model's surface is at most this, metres; undefined if unknown. */
  readonly error: number | undefined;
}

/** Between two points that a person has picked. */
export interface Distance {
  readonly from: End;
  readonly to: End;
}

export interface Snapped extends End {
  readonly to: "vertex" | "edge" | "face";
}

/** A pointed-at place, for asking the service to snap on full detail. */
export interface Aim {
  /** The visible drawable there. */
  readonly drawable: number;
  readonly eye: Point;
  /** Its visible point. */
  readonly at: Point;
  /** The snapping distance as seen from the eye: metres at that point. */
  readonly reach: number;
}

/** The snapping distance, CSS pixels. */
export const REACH = 10;

/**
 * Snaps at a place where a drawable is visible: to a vertex before an edge, and to an edge before a face.
 * Points farther from the surface there than from the pointer are hidden behind it, and ignored.
 */
export function snap(
  at: Place,
  drawable: Drawable,
  { positions, indices }: Triangles,
  projection: Projection,
): Omit<Snapped, "error"> {
  const surface = projection.point(at);
  const nearby = 3 * REACH * projection.metresEach(at.depth);
  const vertex = (index: number) => placed(drawable, positions, index);
  let [best, reach]: [Omit<Snapped, "error">, number] = [{ to: "face", point: surface }, REACH];
  const offer = (to: Snapped["to"], point: Point) => {
    const shown = projection.place(point);
    if (shown === undefined || distance(point, surface) > nearby) {
      return;
    }
    const away = Math.hypot(shown.x - at.x, shown.y - at.y);
    const isBetter = to === best.to || best.to === "face" || to === "vertex";
    const limit = to === best.to ? reach : REACH;
    if (isBetter && away < limit) {
      [best, reach] = [{ to, point }, away];
    }
  };
  for (let corner = 0; corner < indices.length; corner += 1) {
    const next = corner % 3 === 2 ? corner - 2 : corner + 1;
    const [from, to] = [vertex(indices[corner] ?? 0), vertex(indices[next] ?? 0)];
    offer("vertex", from);
    offer("edge", nearestOnLine(from, to, surface));
  }
  return best;
}

/** A vertex in the world. */
function placed({ origin, linear }: Drawable, positions: Float32Array, index: number): Point {
  const [x, y, z] = [positions[3 * index] ?? 0, positions[3 * index + 1] ?? 0, positions[3 * index + 2] ?? 0];
  const at = (axis: 0 | 1 | 2) =>
    origin[axis] + (linear[axis] ?? 0) * x + (linear[3 + axis] ?? 0) * y + (linear[6 + axis] ?? 0) * z;
  return [at(0), at(1), at(2)];
}

function nearestOnLine(from: Point, to: Point, point: Point): Point {
  const [x, y, z] = [to[0] - from[0], to[1] - from[1], to[2] - from[2]];
  const square = x * x + y * y + z * z;
  const along = (point[0] - from[0]) * x + (point[1] - from[1]) * y + (point[2] - from[2]) * z;
  return lerp(from, to, square > 0 ? Math.max(0, Math.min(1, along / square)) : 0);
}

/** The length of a distance, and its error. */
export function measured({ from, to }: Distance): {
  readonly metres: number;
  readonly error: number | undefined;
} {
  const isKnown = from.error !== undefined && to.error !== undefined;
  return {
    metres: distance(from.point, to.point),
    error: isKnown ? (from.error ?? 0) + (to.error ?? 0) : undefined,
  };
}

export function distance(a: Point, b: Point): number {
  return Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}
