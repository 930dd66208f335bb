/** The view state: settings that a user changes while walking. */

import {
  bool,
  bytes,
  type Codec,
  checked,
  type Fields,
  list,
  type Of,
  option,
  record,
  tagged,
  u32,
  whole,
} from "trimaran-transport";
import { dot } from "../space/point.ts";
import { POINT } from "./camera.ts";
import { ObjectSet } from "./objectSet.ts";
import { LEVEL_RULE, OCCLUSION_TEST, type Settings, VIEWPORT } from "./settings.ts";

/** Cuts a part of the scene away: one side of a plane, or the outside of a box. Metres, world. */
const SECTION = tagged("kind", {
  plane: { point: POINT, direction: POINT },
  box: { lower: POINT, upper: POINT },
});

export type Section = Of<typeof SECTION>;

export const OBJECTS: Codec<ObjectSet> = {
  read: (reader) => ObjectSet.read(reader),
  write: (writer, objects) => objects.write(writer),
};

const VIEW_STATE = record({
  pictureSize: VIEWPORT,
  levelRule: LEVEL_RULE,
  occlusionTest: OCCLUSION_TEST,
  /** At most six. The direction of a plane points to the removed side. */
  sections: list(checked(SECTION, faultOf), 6, "sections"),
  /** Objects that are not drawn. */
  hidden: OBJECTS,
  /** If set: only these objects are drawn. */
  isolated: option(OBJECTS),
  /** Objects drawn see-through. By default those of the model. */
  seeThrough: option(OBJECTS),
});

export type ViewState = Of<typeof VIEW_STATE>;

export const { encode: encodeViewState, decode: decodeViewState } = whole(VIEW_STATE);

/** A part of a view state, as sent to a culler. */
export const VIEW_PART = { version: u32, part: bytes, isLast: bool };

export type ViewPart = Fields<typeof VIEW_PART>;

/** Version 0: the settings of the handshake, and the model's see-through objects. */
export function viewStateOf({ viewport, levelRule, occlusionTest }: Settings): ViewState {
  const none = { sections: [], hidden: ObjectSet.EMPTY, isolated: undefined, seeThrough: undefined };
  return { pictureSize: viewport, levelRule, occlusionTest, ...none };
}

/** The parts in which a view state is sent, in order. Throws if a culler would refuse it. */
export function viewParts(version: number, state: ViewState): ViewPart[] {
  const bytes = encodeViewState(state);
  if (bytes.length > MOST_BYTES) {
    throw new RangeError(`a view state of ${bytes.length} bytes: ${MOST_BYTES} is the most`);
  }
  decodeViewState(bytes);
  const parts: ViewPart[] = [];
  for (let from = 0; from < bytes.length; from += MOST_PART) {
    const end = from + MOST_PART;
    parts.push({ version, part: bytes.subarray(from, end), isLast: end >= bytes.length });
  }
  return parts;
}

/** The error in a section, if there is one. */
function faultOf(section: Section): string | undefined {
  const isBox = section.kind === "box";
  const [first, second] = isBox ? [section.lower, section.upper] : [section.point, section.direction];
  if (![...first, ...second].every(Number.isFinite)) {
    return "a coordinate of a section is not finite";
  }
  if (isBox) {
    const isEmpty = first.some((low, axis) => low >= (second[axis] ?? low));
    return isEmpty ? "a section box is empty: its upper corner must lie above its lower one" : undefined;
  }
  const length = Math.sqrt(dot(second, second));
  return length >= 1e-100 && length <= 1e100 ? undefined : "the direction of a section plane points nowhere";
}

/** The most bytes of a part. */
const MOST_PART = 16_000;

/** The most bytes of a view state. */
export const MOST_BYTES = 4_194_304;
