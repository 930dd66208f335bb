/** The plant's coordinates: east, north and up, in metres. See `PlantFrame` of `roles/scene`. */

import { type Box, cornersOf } from "./box.ts";
import { type Axis, dot, minus, type Point, pointOf } from "./point.ts";

export interface PlantFrame {
  /** East, north and up of the scene's origin. */
  readonly origin: Point;
  /** Where north is: degrees clockwise, seen from above, from the scene's -z. */
  readonly north_deg: number;
}

/** The letters of the coordinates, in their order. */
export const LETTERS = ["E", "N", "U"] as const;

/** East, north and up of a point of the scene. */
export function toPlant(frame: PlantFrame, point: Point): Point {
  const turned = wayToPlant(frame, point);
  return pointOf((axis) => frame.origin[axis] + turned[axis]);
}

/** The same of a direction, or of the way between two points. */
export function wayToPlant(frame: PlantFrame, [x, y, z]: Point): Point {
  const [sin, cos] = turnOf(frame);
  return [cos * x + sin * z, sin * x - cos * z, y];
}

/** The point of the scene at these coordinates. */
export function toScene(frame: PlantFrame, coordinates: Point): Point {
  return wayToScene(frame, minus(coordinates, frame.origin));
}

/** The direction of the scene that leads this far to the east, to the north and up. */
export function wayToScene(frame: PlantFrame, [east, north, up]: Point): Point {
  const [sin, cos] = turnOf(frame);
  return [cos * east + sin * north, up, sin * east - cos * north];
}

/** How a way of the plant lies in a picture with these axes, without perspective: to the right and down. */
export function wayInPicture(
  frame: PlantFrame,
  [right, up]: readonly [Point, Point, Point],
  coordinates: Point,
): readonly [number, number] {
  const way = wayToScene(frame, coordinates);
  return [dot(way, right), -dot(way, up)];
}

/** The least and the largest coordinates of a box of the scene, by its corners. */
export function inPlant(frame: PlantFrame, box: Box): Box {
  const corners = cornersOf(box).map((corner) => toPlant(frame, corner));
  const of = (choose: (...numbers: number[]) => number) =>
    pointOf((axis) => choose(...corners.map((corner) => corner[axis])));
  return { min: of(Math.min), max: of(Math.max) };
}

/** A coordinate, and whether it rises along an axis of the scene. */
export interface Along {
  readonly of: Axis;
  readonly rises: boolean;
}

/** The coordinate that changes along an axis of the scene; none where the plant's axes lie at an angle. */
export function alongAxis(frame: PlantFrame, axis: Axis): Along | undefined {
  const way = wayToPlant(
    frame,
    pointOf((other) => (other === axis ? 1 : 0)),
  );
  const of = ([0, 1, 2] as const).find((one) => Math.abs(way[one]) === 1);
  return of === undefined ? undefined : { of, rises: way[of] > 0 };
}

/** The direction of a way over ground: degrees clockwise from north, from 0 to 360; none straight up. */
export function bearingOf(frame: PlantFrame, way: Point): number | undefined {
  const [east, north] = wayToPlant(frame, way);
  return east === 0 && north === 0 ? undefined : ((Math.atan2(east, north) * 180) / Math.PI + 360) % 360;
}

/** Sine and cosine of the angle to north: exact for right angles, so that axes stay axes. */
function turnOf({ north_deg }: PlantFrame): readonly [number, number] {
  const radians = (north_deg * Math.PI) / 180;
  const exact = (value: number) => (north_deg % 90 === 0 ? Math.round(value) : value);
  return [exact(Math.sin(radians)), exact(Math.cos(radians))];
}
