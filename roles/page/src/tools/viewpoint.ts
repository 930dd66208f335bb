/** A view that is kept: where the eye is, and what is changed. As text it stands in a link's address. */

import { decodeViewState, encodeViewState, type Point, type ViewState } from "../proto/viewState.ts";
import type { UserView } from "../viewer/viewHistory.ts";
import { Reader, WireError, Writer } from "../wire/bytes.ts";
import type { Distance } from "./snap.ts";

export interface Viewpoint {
  readonly eye: Point;
  readonly forward: Point;
  /** Vertical field of view, degrees. */
  readonly vfovDeg: number;
  readonly view: UserView;
  readonly distances: readonly Distance[];
}

/** Of the forms of this text the first. */
const VERSION = 1;

/** The most distances that are read. */
const MOST_DISTANCES = 1000;

/** A viewpoint as letters, digits, hyphens and underscores. */
export function encodeViewpoint({ eye, forward, vfovDeg, view, distances }: Viewpoint): string {
  const writer = new Writer();
  writer.u8(VERSION);
  for (const number of [...eye, ...forward, vfovDeg]) {
    writer.f64(number);
  }
  writer.varint(distances.length);
  for (const number of distances.flatMap(({ from, to }) => [...from, ...to])) {
    writer.f64(number);
  }
  // The rest of a view state is each page's own.
  const state: ViewState = {
    ...view,
    pictureSize: { width: 1, height: 1 },
    levelRule: { epsilon: 1, fewPixels: false },
    occlusionTest: "hzb",
  };
  let letters = "";
  // One by one: a call takes only so many arguments.
  for (const byte of [...writer.take(), ...encodeViewState(state)]) {
    letters += String.fromCharCode(byte);
  }
  return btoa(letters).replaceAll("+", "-").replaceAll("/", "_").replaceAll("=", "");
}

/** The reverse; nothing where the text is no viewpoint. */
export function decodeViewpoint(text: string): Viewpoint | undefined {
  try {
    const bytes = Uint8Array.from(atob(text.replaceAll("-", "+").replaceAll("_", "/")), (letter) =>
      letter.charCodeAt(0),
    );
    const reader = new Reader(bytes);
    const version = reader.u8();
    const point = (): Point => [reader.f64(), reader.f64(), reader.f64()];
    const [eye, forward, vfovDeg] = [point(), point(), reader.f64()];
    const count = reader.varintCount();
    if (count > MOST_DISTANCES) {
      return undefined;
    }
    const distances = Array.from({ length: count }, () => ({ from: point(), to: point() }));
    const { sections, hidden, isolated, seeThrough } = decodeViewState(reader.rest());
    const numbers = [...eye, ...forward, vfovDeg, ...distances.flatMap(({ from, to }) => [...from, ...to])];
    if (version !== VERSION || !numbers.every(Number.isFinite)) {
      return undefined;
    }
    return { eye, forward, vfovDeg, view: { sections, hidden, isolated, seeThrough }, distances };
  } catch (error) {
    if (error instanceof WireError || error instanceof DOMException) {
      return undefined;
    }
    throw error;
  }
}
