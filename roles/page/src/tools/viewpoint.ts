/** A view that is kept: where the eye is, and what is changed. As text it stands in a link's address. */

import { decodeViewState, encodeViewState, type Point, type ViewState } from "../proto/viewState.ts";
import type { UserView } from "../viewer/viewHistory.ts";
import { Reader, WireError, Writer } from "../wire/bytes.ts";

export interface Viewpoint {
  readonly eye: Point;
  readonly forward: Point;
  /** Vertical field of view, degrees. */
  readonly vfovDeg: number;
  readonly view: UserView;
}

/** Of the forms of this text the first. */
const VERSION = 1;

/** A viewpoint as letters, digits, hyphens and underscores. */
export function encodeViewpoint({ eye, forward, vfovDeg, view }: Viewpoint): string {
  const writer = new Writer();
  writer.u8(VERSION);
  for (const number of [...eye, ...forward, vfovDeg]) {
    writer.f64(number);
  }
  // The rest of a view state is each page's own.
  const state: ViewState = {
    ...view,
    pictureSize: { width: 1, height: 1 },
    levelRule: { epsilon: 1, fewPixels: false },
    occlusionTest: "hzb",
  };
  const bytes = [...writer.take(), ...encodeViewState(state)];
  const text = btoa(String.fromCharCode(...bytes));
  return text.replaceAll("+", "-").replaceAll("/", "_").replaceAll("=", "");
}

/** The reverse; nothing where the text is no viewpoint. */
export function decodeViewpoint(text: string): Viewpoint | undefined {
  try {
    const bytes = Uint8Array.from(atob(text.replaceAll("-", "+").replaceAll("_", "/")), (letter) =>
      letter.charCodeAt(0),
    );
    const reader = new Reader(bytes.subarray(0, 57));
    const version = reader.u8();
    const point = (): Point => [reader.f64(), reader.f64(), reader.f64()];
    const [eye, forward, vfovDeg] = [point(), point(), reader.f64()];
    const { sections, hidden, isolated, seeThrough } = decodeViewState(bytes.subarray(57));
    const isSound = version === VERSION && [...eye, ...forward, vfovDeg].every(Number.isFinite);
    return isSound ? { eye, forward, vfovDeg, view: { sections, hidden, isolated, seeThrough } } : undefined;
  } catch (error) {
    if (error instanceof WireError || error instanceof DOMException) {
      return undefined;
    }
    throw error;
  }
}
