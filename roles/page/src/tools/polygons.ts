/** The area and the perimeter of a polygon whose corners a person has picked. */

import type { Snapped } from "../service/service.ts";
import { beyond, cross, distance, dot, lerp, minus, type Point, pointOf } from "../space/point.ts";
import { lengthText, measuredText, type Unit } from "./lengths.ts";

/** A share of the squared perimeter; what is below is rounding. */
const NOTHING = 1e-9;
/** Corners this near to a plane are on it, metres. */
const FLAT = 0.0005;
/** Metres. */
const FOOT = 0.3048;

export interface Polygon {
  /** The area of its projection on the plane that fits it best, square metres; nothing if its edges cross. */
  readonly area: number | undefined;
  readonly perimeter: number;
  /** The largest distance of a corner from that plane, metres. */
  readonly off: number;
}

/**
 * The measures of a polygon, by Newell's formula; nothing if it has fewer than three corners, or if all of
 * them are on one line. Edges that only touch do not cross.
 */
export function polygonOf(corners: readonly Point[]): Polygon | undefined {
  const [first] = corners;
  if (first === undefined) {
    return undefined;
  }
  // From the first corner: it may be far from the origin.
  const places = corners.map((corner) => minus(corner, first));
  const edges = around(places);
  const perimeter = edges.reduce((sum, [from, to]) => sum + distance(from, to), 0);
  const turns = edges.map(([from, to]) => cross(from, to));
  const least = NOTHING * perimeter ** 2;
  const longest = turns.reduce((a, b) => (dot(b, b) > dot(a, a) ? b : a));
  if (!(Math.hypot(...longest) > least)) {
    return undefined;
  }
  const all = turns.reduce((a, b) => beyond(a, b, 1));
  const twice = Math.hypot(...all);
  // The parts of an eight may cancel out.
  const normal = unit(twice > least ? all : longest);
  const sum = places.reduce((a, b) => beyond(a, b, 1));
  const middle = lerp([0, 0, 0], sum, 1 / places.length);
  const off = Math.max(...places.map((place) => Math.abs(dot(minus(place, middle), normal))));
  return { area: doCross(edges, normal, least) ? undefined : twice / 2, perimeter, off };
}

/** The result as text: the area, the perimeter, and how far the corners are from a plane if they are. */
export function polygonTexts(corners: readonly Snapped[], unit: Unit): readonly string[] {
  const polygon = polygonOf(corners.map(({ point }) => point));
  if (polygon === undefined) {
    return ["no area: all corners are on one line"];
  }
  const { area, perimeter, off } = polygon;
  const errors = errorsOf(corners);
  const texts = [`perimeter ${measuredText(perimeter, errors?.perimeter, unit)}`];
  if (area === undefined) {
    return ["no area: the edges cross", ...texts];
  }
  const text = areaText(area, errors?.area, unit);
  const isFlat = off < FLAT;
  return isFlat
    ? [text, ...texts]
    : [`${text} projected on a plane`, ...texts, `corners up to ${lengthText(off, unit)} off that plane`];
}

/** An area with its error: see `measuredText`. */
export function areaText(squareMetres: number, error: number | undefined, unit: Unit): string {
  const [each, digits, name] = unit === "ft-in" ? [FOOT ** 2, 3, "ft²"] : [1, 4, "m²"];
  const written = (area: number) => `${area.toFixed(digits)} ${name}`;
  const [text, last] = [written(squareMetres / each), 10 ** -digits];
  if (error === undefined) {
    return `about ${text}`;
  }
  const steps = error / each / last;
  return steps < 0.5 ? text : `${text} ± ${written(last * Math.ceil(steps - 1e-6))}`;
}

/** The errors of the area and of the perimeter by those of the corners; nothing if one is unknown. */
function errorsOf(corners: readonly Snapped[]): { area: number; perimeter: number } | undefined {
  let [area, perimeter] = [0, 0];
  for (const [at, { error }] of corners.entries()) {
    const [before, after] = [corners.at(at - 1), corners[(at + 1) % corners.length]];
    if (error === undefined || before === undefined || after === undefined) {
      return undefined;
    }
    area += (error * distance(before.point, after.point)) / 2;
    perimeter += 2 * error;
  }
  return { area, perimeter };
}

/** Each with the next one, and the last with the first. */
export function around<T>(all: readonly T[]): readonly (readonly [T, T])[] {
  return all.flatMap((one, at) => {
    const next = all[(at + 1) % all.length];
    return next === undefined ? [] : [[one, next] as const];
  });
}

type Edge = readonly [Point, Point];

/** Whether two edges cross as seen along the normal. */
function doCross(edges: readonly Edge[], normal: Point, least: number): boolean {
  /** On which side of an edge a place is: 1 or -1, or 0 on it. */
  const side = ([from, to]: Edge, place: Point) => {
    const turn = dot(cross(minus(to, from), minus(place, from)), normal);
    return Math.abs(turn) > least ? Math.sign(turn) : 0;
  };
  const divides = (edge: Edge, [from, to]: Edge) => side(edge, from) * side(edge, to) < 0;
  return edges.some((one, at) => {
    return edges.slice(at + 1).some((other) => divides(one, other) && divides(other, one));
  });
}

function unit(way: Point): Point {
  const length = Math.hypot(...way);
  return pointOf((axis) => way[axis] / length);
}
