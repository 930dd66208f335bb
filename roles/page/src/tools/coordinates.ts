/** Plant coordinates as a person reads them. */

import type { End } from "../service/service.ts";
import type { Box } from "../space/box.ts";
import { bearingOf, inPlant, LETTERS, type PlantFrame, toPlant, wayToPlant } from "../space/plantFrame.ts";
import type { Point } from "../space/point.ts";
import { coordinateText, lengthText, type Unit } from "./lengths.ts";

/** The directions over ground, clockwise from north. */
const DIRECTIONS = ["N", "NE", "E", "SE", "S", "SW", "W", "NW"];
/** Errors below this are not told, metres. */
const UNTOLD = 0.0005;

/** The coordinates of a point of the scene: `E 1.000 m, N 2.000 m, U 3.000 m`. */
export function placeText(frame: PlantFrame, point: Point, unit: Unit): string {
  return written(toPlant(frame, point), unit, "");
}

/** The way between two points of the scene by its parts: `dE 1.000 m, dN -2.000 m, dU 0.000 m`. */
export function wayText(frame: PlantFrame, way: Point, unit: Unit): string {
  return written(wayToPlant(frame, way), unit, "d");
}

/** The possible error of a point, behind its coordinates; empty for a point of full detail. */
export function errorText({ error }: Pick<End, "error">, unit: Unit): string {
  if (error === undefined) {
    return " (about)";
  }
  return error < UNTOLD ? "" : ` ± ${lengthText(error, unit)}`;
}

/** The range of each coordinate in a box of the scene: `E 1.000 m to 2.000 m`. */
export function rangeTexts(frame: PlantFrame, box: Box, unit: Unit): readonly string[] {
  const { min, max } = inPlant(frame, box);
  return LETTERS.map((letter, axis) => {
    const [from, to] = [min[axis] ?? 0, max[axis] ?? 0];
    return `${letter} ${coordinateText(from, unit)} to ${coordinateText(to, unit)}`;
  });
}

/** Where a gaze leads: `NE 045°, 12° down`. */
export function gazeText(frame: PlantFrame, forward: Point): string {
  const bearing = bearingOf(frame, forward) ?? 0;
  const slope = (Math.asin(Math.max(-1, Math.min(1, forward[1]))) * 180) / Math.PI;
  const [ahead, steep] = [Math.round(bearing) % 360, Math.round(Math.abs(slope))];
  const level = `${DIRECTIONS[Math.round(bearing / 45) % 8]} ${String(ahead).padStart(3, "0")}°`;
  return steep === 0 ? `${level}, level` : `${level}, ${steep}° ${slope < 0 ? "down" : "up"}`;
}

function written(coordinates: Point, unit: Unit, before: string): string {
  return LETTERS.map(
    (letter, axis) => `${before}${letter} ${coordinateText(coordinates[axis] ?? 0, unit)}`,
  ).join(", ");
}
