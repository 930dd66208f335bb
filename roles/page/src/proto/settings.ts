/** The display's settings of a session. */

import { type Reader, WireError, type Writer } from "../wire/bytes.ts";
import { MOST_ITEMS } from "../wire/messages.ts";

/** How a culler tests whether a node's box is visible. */
export const OCCLUSION_TESTS = ["query", "raster", "hzb"] as const;

export type OcclusionTest = (typeof OCCLUSION_TESTS)[number];

/** How ids may be coded. */
export const CODINGS = ["plain", "changes"] as const;

export type Coding = (typeof CODINGS)[number];

/** A picture's size in pixels, each side 1 to 65,536. */
export interface Viewport {
  readonly width: number;
  readonly height: number;
}

/** The rule for levels of detail. */
export interface LevelRule {
  /** Error bound in pixels: finite, above 0. */
  readonly epsilon: number;
  /** Culling stops at nodes visible at fewer pixels than that. */
  readonly fewPixels: boolean;
}

export interface Settings {
  readonly viewport: Viewport;
  readonly levelRule: LevelRule;
  /** Ids in a batch at most, 1 to 16,384. */
  readonly batch: number;
  readonly coding: Coding;
  readonly occlusionTest: OcclusionTest;
}

export function writeSettings(writer: Writer, settings: Settings): void {
  writeViewport(writer, settings.viewport);
  writeLevelRule(writer, settings.levelRule);
  writer.varint(settings.batch).variant(CODINGS, settings.coding);
  writer.variant(OCCLUSION_TESTS, settings.occlusionTest);
}

export function readSettings(reader: Reader): Settings {
  const viewport = readViewport(reader);
  const levelRule = readLevelRule(reader);
  const batch = reader.varint32();
  if (batch < 1 || batch > MOST_ITEMS) {
    throw new WireError(`a batch of ${batch} is outside 1 to ${MOST_ITEMS}`);
  }
  const coding = reader.variant(CODINGS);
  return { viewport, levelRule, batch, coding, occlusionTest: reader.variant(OCCLUSION_TESTS) };
}

export function writeViewport(writer: Writer, { width, height }: Viewport): void {
  writer.varint(width).varint(height);
}

export function readViewport(reader: Reader): Viewport {
  const viewport = { width: reader.varint32(), height: reader.varint32() };
  const { width, height } = viewport;
  if (Math.min(width, height) < 1 || Math.max(width, height) > MOST_PIXELS) {
    throw new WireError(`a picture of ${width}x${height} pixels has a side outside 1 to ${MOST_PIXELS}`);
  }
  return viewport;
}

export function writeLevelRule(writer: Writer, { epsilon, fewPixels }: LevelRule): void {
  writer.f64(epsilon).bool(fewPixels);
}

export function readLevelRule(reader: Reader): LevelRule {
  const epsilon = reader.f64();
  if (!(Number.isFinite(epsilon) && epsilon > 0)) {
    throw new WireError(`an error bound of ${epsilon} pixels: it must be a finite number above 0`);
  }
  return { epsilon, fewPixels: reader.bool() };
}

/** The most pixels of a side of a picture. */
const MOST_PIXELS = 65_536;
