/** From where a person points to what they mean: a vertex, an edge, or a face. */

import type { Drawable } from "../draw/model.ts";
import type { Point } from "../proto/viewState.ts";
import { lerp, type Place, type Projection } from "./projection.ts";

/** The triangles of a piece of geometry, in its local frame. */
export interface Triangles {
  /** Three numbers a vertex. */
  readonly positions: Float32Array;
  /** Three a triangle. */
  readonly indices: Uint32Array;
}

/** Between two points that a person has picked. */
export interface Distance {
  readonly from: Point;
  readonly to: Point;
}

export interface Snapped {
  readonly to: "vertex" | "edge" | "face";
  readonly point: Point;
}

/** What is nearer to the pointer draws it: CSS pixels. */
const REACH = 10;

/**
 * What is meant at a place where a drawable shows. A vertex goes before an edge, and an edge before a face.
 * Nothing counts that is farther from the surface there than it looks: it is hidden behind.
 */
export function snap(
  at: Place,
  drawable: Drawable,
  { positions, indices }: Triangles,
  projection: Projection,
): Snapped {
  const surface = projection.point(at);
  const nearby = 3 * REACH * projection.metresEach(at.depth);
  const vertex = (index: number) => placed(drawable, positions, index);
  let [best, reach]: [Snapped, number] = [{ to: "face", point: surface }, REACH];
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

export function distance(a: Point, b: Point): number {
  return Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}
