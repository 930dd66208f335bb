/** The view state: settings that a user changes while walking. */

import type { Point } from "../space/point.ts";
import { Reader, WireError, Writer } from "../wire/bytes.ts";
import { ObjectSet } from "./objectSet.ts";
import {
  type LevelRule,
  OCCLUSION_TESTS,
  type OcclusionTest,
  readLevelRule,
  readViewport,
  type Settings,
  type Viewport,
  writeLevelRule,
  writeViewport,
} from "./settings.ts";

/** Cuts a part of the scene away: one side of a plane, or the outside of a box. Metres, world. */
export type Section =
  | { readonly kind: "plane"; readonly point: Point; readonly direction: Point }
  | { readonly kind: "box"; readonly lower: Point; readonly upper: Point };

export interface ViewState {
  readonly pictureSize: Viewport;
  readonly levelRule: LevelRule;
  readonly occlusionTest: OcclusionTest;
  /** At most six. The direction of a plane points to the removed side. */
  readonly sections: readonly Section[];
  /** Objects that are not drawn. */
  readonly hidden: ObjectSet;
  /** If set: only these objects are drawn. */
  readonly isolated?: ObjectSet | undefined;
  /** Objects drawn see-through. By default those of the model. */
  readonly seeThrough?: ObjectSet | undefined;
}

/** A part of a view state, as sent to a culler. */
export interface ViewPart {
  readonly version: number;
  readonly part: Uint8Array;
  readonly isLast: boolean;
}

/** Version 0: the settings of the handshake, and the model's see-through objects. */
export function viewStateOf({ viewport, levelRule, occlusionTest }: Settings): ViewState {
  const none = { sections: [], hidden: ObjectSet.EMPTY, isolated: undefined, seeThrough: undefined };
  return { pictureSize: viewport, levelRule, occlusionTest, ...none };
}

export function encodeViewState(state: ViewState): Uint8Array<ArrayBuffer> {
  const writer = new Writer();
  writeViewport(writer, state.pictureSize);
  writeLevelRule(writer, state.levelRule);
  writer.variant(OCCLUSION_TESTS, state.occlusionTest).varint(state.sections.length);
  for (const section of state.sections) {
    writeSection(writer, section);
  }
  state.hidden.write(writer);
  writer.option(state.isolated, (isolated) => isolated.write(writer));
  writer.option(state.seeThrough, (seeThrough) => seeThrough.write(writer));
  return writer.take();
}

export function decodeViewState(bytes: Uint8Array): ViewState {
  const reader = new Reader(bytes);
  const pictureSize = readViewport(reader);
  const levelRule = readLevelRule(reader);
  const occlusionTest = reader.variant(OCCLUSION_TESTS);
  const count = reader.varintCount();
  if (count > MOST_SECTIONS) {
    throw new WireError(`${count} sections: there can be ${MOST_SECTIONS}`);
  }
  const sections = Array.from({ length: count }, () => readSection(reader));
  const hidden = ObjectSet.read(reader);
  const isolated = reader.option(() => ObjectSet.read(reader));
  const seeThrough = reader.option(() => ObjectSet.read(reader));
  reader.end();
  return { pictureSize, levelRule, occlusionTest, sections, hidden, isolated, seeThrough };
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

function writeSection(writer: Writer, section: Section): void {
  const isPlane = section.kind === "plane";
  const points = isPlane ? [section.point, section.direction] : [section.lower, section.upper];
  writer.variant(SECTIONS, section.kind);
  for (const coordinate of points.flat()) {
    writer.f64(coordinate);
  }
}

function readSection(reader: Reader): Section {
  const kind = reader.variant(SECTIONS);
  const first = readPoint(reader);
  const second = readPoint(reader);
  if (![...first, ...second].every(Number.isFinite)) {
    throw new WireError("a coordinate of a section is not finite");
  }
  if (kind === "box") {
    if (first.some((low, axis) => low >= (second[axis] ?? low))) {
      throw new WireError("a section box is empty: its upper corner must lie above its lower one");
    }
    return { kind, lower: first, upper: second };
  }
  const length = Math.sqrt(second.reduce((sum, coordinate) => sum + coordinate * coordinate, 0));
  if (!(length >= 1e-100 && length <= 1e100)) {
    throw new WireError("the direction of a section plane points nowhere");
  }
  return { kind, point: first, direction: second };
}

function readPoint(reader: Reader): Point {
  return [reader.f64(), reader.f64(), reader.f64()];
}

/** The kinds of sections, in the order of their numbers. */
const SECTIONS = ["plane", "box"] as const;

/** The most sections. */
const MOST_SECTIONS = 6;

/** The most bytes of a part. */
const MOST_PART = 16_000;

/** The most bytes of a view state. */
const MOST_BYTES = 4_194_304;
