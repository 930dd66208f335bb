/** The faces of sections in the plant's coordinates. */

import type { Section } from "../proto/viewState.ts";
import { alongAxis, LETTERS, type PlantFrame, toPlant } from "../space/plantFrame.ts";
import type { Axis } from "../space/point.ts";
import { placeText } from "./coordinates.ts";
import { AXES } from "./handles.ts";
import { coordinateText, type Unit } from "./lengths.ts";

/** A side of a box, and its coordinate. */
export interface BoxFace {
  readonly name: string;
  readonly side: "lower" | "upper";
  /** The scene's axis that it lies across. */
  readonly axis: Axis;
  /** Its coordinate, metres. */
  readonly at: number;
  /** The place on the scene's axis of such a coordinate. */
  readonly atOf: (coordinate: number) => number;
}

/** The two sides of a box across an axis, by rising coordinates. */
export interface BoxFaces {
  readonly letter: string;
  readonly low: BoxFace;
  readonly high: BoxFace;
}

/**
 * The sides of a box, as E, N and U. Where the plant's axes lie at an angle to those of the scene, the sides
 * across the ground are named by the scene's axes and have its coordinates.
 */
export function facesOf(frame: PlantFrame, box: Extract<Section, { kind: "box" }>): readonly BoxFaces[] {
  const faces = AXES.map(([axis, name]) => {
    const along = alongAxis(frame, axis);
    const sign = along === undefined || along.rises ? 1 : -1;
    const shift = along === undefined ? 0 : frame.origin[along.of];
    const letter = along === undefined ? name : LETTERS[along.of];
    const face = (side: "lower" | "upper", word: string): BoxFace => ({
      name: `${word} ${letter}`,
      side,
      axis,
      at: shift + sign * box[side][axis],
      atOf: (coordinate) => sign * (coordinate - shift),
    });
    const [first, second] = sign > 0 ? (["lower", "upper"] as const) : (["upper", "lower"] as const);
    return { letter, low: face(first, "lower"), high: face(second, "upper") };
  });
  const order = [...LETTERS, "x", "z"] as readonly string[];
  return faces.sort((a, b) => order.indexOf(a.letter) - order.indexOf(b.letter));
}

/** Where a plane is: its coordinate if it lies across an axis of the plant, or else a point of it. */
export function planeText(frame: PlantFrame, section: Section, unit: Unit): string {
  if (section.kind === "box") {
    return "";
  }
  const { point, direction } = section;
  const across = ([0, 1, 2] as const).filter((axis) => direction[axis] !== 0);
  const along = across.length === 1 && across[0] !== undefined ? alongAxis(frame, across[0]) : undefined;
  return along === undefined
    ? placeText(frame, point, unit)
    : `${LETTERS[along.of]} ${coordinateText(toPlant(frame, point)[along.of], unit)}`;
}
