/** A viewpoint: the eye's pose, and the changes of the view. Its text form is part of a link's address. */

import { MODES, type Mode } from "../navigate/navigator.ts";
import { decodeViewState, encodeViewState, type ViewState } from "../proto/viewState.ts";
import type { End, SceneDescription } from "../service/service.ts";
import type { Point } from "../space/point.ts";
import type { UserView } from "../viewer/viewHistory.ts";
import { cutText, Reader, shownText, WireError, Writer } from "../wire/bytes.ts";

/** A viewpoint's reference to its scene. */
export type SceneName = Pick<SceneDescription, "name" | "fingerprint">;

export interface Viewpoint {
  readonly scene: SceneName;
  readonly eye: Point;
  readonly forward: Point;
  /** Vertical field of view, degrees. */
  readonly vfovDeg: number;
  readonly mode: Mode;
  readonly view: UserView;
}

/** The version of this text form. */
const VERSION = 3;

/** The most distances that are read. */
const MOST_DISTANCES = 1000;
/** The most bytes of a scene's name. */
const LONGEST_NAME = 100;

/** A viewpoint as letters, digits, hyphens and underscores. */
export function encodeViewpoint({ scene, eye, forward, vfovDeg, mode, view }: Viewpoint): string {
  const writer = new Writer();
  const { distances, ...seen } = view;
  writer.u8(VERSION).u64(BigInt(`0x${scene.fingerprint.slice(16)}`));
  writer.u64(BigInt(`0x${scene.fingerprint.slice(0, 16)}`)).text(cutText(scene.name, LONGEST_NAME));
  writer.variant(MODES, mode);
  for (const number of [...eye, ...forward, vfovDeg]) {
    writer.f64(number);
  }
  writer.varint(distances.length);
  for (const { point, error } of distances.flatMap(({ from, to }) => [from, to])) {
    for (const number of point) {
      writer.f64(number);
    }
    writer.option(error, (error) => writer.f64(error));
  }
  // The rest of a view state belongs to each page.
  const state: ViewState = {
    ...seen,
    pictureSize: { width: 1, height: 1 },
    levelRule: { epsilon: 1, fewPixels: false },
    occlusionTest: "hzb",
  };
  const bytes = writer.bytes(encodeViewState(state)).take();
  const text = btoa(Array.from(bytes, (byte) => String.fromCharCode(byte)).join(""));
  return text.replaceAll("+", "-").replaceAll("/", "_").replaceAll("=", "");
}

/** The reverse; nothing if the text is not a valid viewpoint. */
export function decodeViewpoint(text: string): Viewpoint | undefined {
  try {
    const bytes = Uint8Array.from(atob(text.replaceAll("-", "+").replaceAll("_", "/")), (letter) =>
      letter.charCodeAt(0),
    );
    const reader = new Reader(bytes);
    if (reader.u8() !== VERSION) {
      return undefined;
    }
    const fingerprint = reader.u128().toString(16).padStart(32, "0");
    const scene = { name: reader.text(LONGEST_NAME), fingerprint };
    const mode = reader.variant(MODES);
    const point = (): Point => [reader.f64(), reader.f64(), reader.f64()];
    const [eye, forward, vfovDeg] = [point(), point(), reader.f64()];
    const count = reader.varintCount();
    if (count > MOST_DISTANCES) {
      return undefined;
    }
    const end = (): End => ({ point: point(), error: reader.option(() => reader.f64()) });
    const distances = Array.from({ length: count }, () => ({ from: end(), to: end() }));
    const { sections, hidden, isolated, seeThrough } = decodeViewState(reader.rest());
    const ends = distances.flatMap(({ from, to }) => [from, to]);
    const measured = ends.flatMap(({ point, error = 0 }) => [...point, error]);
    if (seeThrough === undefined || ![...eye, ...forward, vfovDeg, ...measured].every(Number.isFinite)) {
      return undefined;
    }
    return {
      scene,
      eye,
      forward,
      vfovDeg,
      mode,
      view: { sections, hidden, isolated, seeThrough, distances },
    };
  } catch (error) {
    if (error instanceof WireError || error instanceof DOMException) {
      return undefined;
    }
    throw error;
  }
}

/** Why a viewpoint cannot be shown in a scene, as the end of a sentence; nothing if it can. */
export function foreign({ scene: own }: Viewpoint, scene: SceneName): string | undefined {
  if (own.fingerprint === scene.fingerprint) {
    return undefined;
  }
  const called = ({ name, fingerprint }: SceneName) =>
    `“${shownText(name)}” (fingerprint ${fingerprint.slice(0, 8)}…)`;
  const hint = own.name === scene.name ? ": the model has changed since" : "";
  return `it is of the scene ${called(own)}, and this is ${called(scene)}${hint}`;
}
