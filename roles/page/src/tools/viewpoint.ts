/** A viewpoint: the eye's pose, and the changes of the view. Its text form is part of a link's address. */

import {
  checked,
  f64,
  list,
  number,
  option,
  record,
  rest,
  shownText,
  text,
  u8,
  u32,
  variant,
  WireError,
  whole,
} from "trimaran-transport";
import { MOST_PAINTS, NO_COLOURS } from "../draw/colours.ts";
import { MODES, type Mode } from "../navigate/navigator.ts";
import { POINT } from "../proto/camera.ts";
import { decodeViewState, encodeViewState, OBJECTS } from "../proto/viewState.ts";
import type { SceneDescription } from "../service/service.ts";
import type { Point } from "../space/point.ts";
import type { UserView } from "../viewer/viewHistory.ts";

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

const END = record({ point: POINT, error: option(f64) });

/** Fields of every version. */
const FIELDS = {
  version: u8,
  fingerprint: number("u128"),
  name: text(100),
  mode: variant(MODES),
  eye: POINT,
  forward: POINT,
  vfovDeg: f64,
  distances: list(record({ from: END, to: END }), 1000, "distances"),
};

const COLOURING = record({
  by: text(400),
  paints: list(record({ label: text(400), colour: u32, objects: OBJECTS }), MOST_PAINTS, "colours"),
});

/** The value behind the text form without colours, and with them. A view state ends it. */
const plain = whole(checked(record({ ...FIELDS, view: rest }), faultOf));
const coloured = whole(
  checked(record({ ...FIELDS, colouring: COLOURING, view: rest }), (value) => {
    const isColour = value.colouring.paints.every(({ colour }) => colour <= 0xff_ffff);
    return isColour ? faultOf(value) : "a colour has more than 24 bits";
  }),
);

/** The versions of these text forms. */
const PLAIN = 3;
const COLOURED = 4;

function faultOf(value: Pick<Viewpoint, "eye" | "forward" | "vfovDeg"> & Pick<UserView, "distances">) {
  const { eye, forward, vfovDeg, distances } = value;
  const ends = distances.flatMap(({ from, to }) => [from, to]);
  const numbers = ends.flatMap(({ point, error = 0 }) => [...point, error]);
  const areFinite = [...eye, ...forward, vfovDeg, ...numbers].every(Number.isFinite);
  return areFinite ? undefined : "a number is not finite";
}

/** A viewpoint as letters, digits, hyphens and underscores. */
export function encodeViewpoint({ scene, view, ...pose }: Viewpoint): string {
  const { distances, colouring, ...seen } = view;
  // The rest of a view state belongs to each page.
  const state = encodeViewState({
    ...seen,
    pictureSize: { width: 1, height: 1 },
    levelRule: { epsilon: 1, fewPixels: false },
    occlusionTest: "hzb",
  });
  const fingerprint = BigInt(`0x${scene.fingerprint}`);
  const fields = { ...pose, fingerprint, name: scene.name, distances, view: state };
  const hasColours = colouring.paints.length > 0 || colouring.by !== "";
  const bytes = hasColours
    ? coloured.encode({ ...fields, version: COLOURED, colouring })
    : plain.encode({ ...fields, version: PLAIN });
  const text = btoa(Array.from(bytes, (byte) => String.fromCharCode(byte)).join(""));
  return text.replaceAll("+", "-").replaceAll("/", "_").replaceAll("=", "");
}

/** The reverse; nothing if the text is not a valid viewpoint. */
export function decodeViewpoint(text: string): Viewpoint | undefined {
  try {
    const letters = atob(text.replaceAll("-", "+").replaceAll("_", "/"));
    const bytes = Uint8Array.from(letters, (letter) => letter.charCodeAt(0));
    const [version = 0] = bytes;
    if (version !== PLAIN && version !== COLOURED) {
      return undefined;
    }
    const decoded =
      version === PLAIN ? { ...plain.decode(bytes), colouring: NO_COLOURS } : coloured.decode(bytes);
    const { eye, forward, vfovDeg, mode, name, distances, colouring, ...read } = decoded;
    const fingerprint = read.fingerprint.toString(16).padStart(32, "0");
    const { sections, hidden, isolated, seeThrough } = decodeViewState(read.view);
    const view = seeThrough && { sections, hidden, isolated, seeThrough, distances, colouring };
    return view && { scene: { name, fingerprint }, eye, forward, vfovDeg, mode, view };
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
