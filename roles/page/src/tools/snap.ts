/** Snaps the pointer to a vertex, an edge, or a face. */

import type { Drawable, Triangles } from "../draw/model.ts";
import type { Place, Projection } from "../draw/projection.ts";
import type { Snapped } from "../service/service.ts";
import { distance, dot, lerp, minus, type Point, pointOf } from "../space/point.ts";
import type { Distance } from "../viewer/viewHistory.ts";

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
  return pointOf(
    (axis) =>
      origin[axis] + (linear[axis] ?? 0) * x + (linear[3 + axis] ?? 0) * y + (linear[6 + axis] ?? 0) * z,
  );
}

function nearestOnLine(from: Point, to: Point, point: Point): Point {
  const way = minus(to, from);
  const square = dot(way, way);
  const along = dot(minus(point, from), way);
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
