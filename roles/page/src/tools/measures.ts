/** The measures that clicks can take, and their geometry. */

import type { Snapped } from "../service/service.ts";
import { beyond, cross, distance, dot, minus, type Point } from "../space/point.ts";
import type { Distance } from "../viewer/viewHistory.ts";

/** The measures, how many points each takes, and what to click. */
export const MEASURES = {
  points: { points: 2, text: "Two points", hint: "Click two points." },
  parts: { points: 0, text: "Two parts", hint: "Pick two parts, in the picture, the tree or the search." },
  perpendicular: { points: 2, text: "Point to face", hint: "Click a point, and then a flat face." },
  angle: { points: 3, text: "Angle", hint: "Click three points: the angle is at the second one." },
  surface: { points: 1, text: "Area or diameter", hint: "Click a flat face, or a round one." },
  polygon: {
    points: Number.POSITIVE_INFINITY,
    text: "Polygon",
    hint: "Click its corners. A click on the first one, a double click or Enter closes it.",
  },
} as const;

/** The fewest corners of a polygon. */
export const FEWEST = 3;

export type Measure = keyof typeof MEASURES;

/** The angle at the second of three points, degrees; nothing if two of them are one. */
export function angleAt([a, b, c]: readonly [Point, Point, Point]): number | undefined {
  const [u, v] = [minus(a, b), minus(c, b)];
  const lengths = Math.hypot(...u) * Math.hypot(...v);
  // By the tangent: the cosine says little of angles near 0 and 180 degrees.
  const across = Math.hypot(...cross(u, v));
  return lengths > 0 ? (Math.atan2(across, dot(u, v)) * 180) / Math.PI : undefined;
}

/** The error of such an angle, degrees, by the errors of its points; nothing if one is unknown. */
export function angleError(ends: readonly [Snapped, Snapped, Snapped]): number | undefined {
  const [a, b, c] = ends;
  if (a.error === undefined || b.error === undefined || c.error === undefined) {
    return undefined;
  }
  const turn = (end: Snapped, error: number) => (error + (b.error ?? 0)) / distance(end.point, b.point);
  return ((turn(a, a.error) + turn(c, c.error)) * 180) / Math.PI;
}

/** The distance from a point to the plane of a face; nothing if the face is unknown. */
export function perpendicular(from: Snapped, { face, error }: Snapped): Distance | undefined {
  if (face == null) {
    return undefined;
  }
  const steps = dot(minus(face.point, from.point), face.normal);
  return { from, to: { point: beyond(from.point, face.normal, steps), error } };
}
