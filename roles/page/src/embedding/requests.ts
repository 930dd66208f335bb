/** Requests of the page around this one, checked. */

import type { PartRef, Pose, Request, Triple } from "../../../../examples/embedding/trimaran.d.ts";
import { isParallel } from "../navigate/parallel.ts";

/** The version of the messages. */
export const VERSION = 1;
/** The most parts in a request, and the most letters of a name, of an id and of a view. */
const MOST_PARTS = 100;
const LONGEST_NAME = 1000;
const LONGEST_ID = 100;
const LONGEST_VIEW = 8 << 20;
/** The farthest coordinate, metres. */
const FARTHEST = 1e15;

/** A request is invalid. The message says why. */
export class RequestError extends Error {}

type Fields = Readonly<Record<string, unknown>>;

/** Whether a message claims to be a request. Other scripts send other messages. */
export function isMeant(data: unknown): data is Fields {
  return isRecord(data) && "trimaran" in data;
}

/** The id of a message, if it is one. */
export function idOf({ id }: Fields): number | string | undefined {
  const isId = Number.isFinite(id) || (typeof id === "string" && id.length <= LONGEST_ID);
  return isId ? (id as number | string) : undefined;
}

/** Checks a request. Throws a `RequestError`. */
export function parseRequest(fields: Fields): Request {
  if (fields.trimaran !== VERSION) {
    throw new RequestError(`this page speaks version ${VERSION}: send "trimaran": ${VERSION}`);
  }
  const id = idOf(fields);
  if (id === undefined) {
    throw new RequestError(`"id" is a finite number, or a text of at most ${LONGEST_ID} letters`);
  }
  const head = { trimaran: VERSION, id } as const;
  switch (fields.do) {
    case "hello":
    case "showAll":
      only(fields);
      return { ...head, do: fields.do };
    case "goTo":
      only(fields, "part");
      return { ...head, do: "goTo", part: partOf(fields.part) };
    case "select":
    case "isolate":
    case "hide":
      only(fields, "parts");
      return { ...head, do: fields.do, parts: partsOf(fields.parts) };
    case "setView":
      if ("view" in fields) {
        only(fields, "view");
        return { ...head, do: "setView", view: textOf(fields.view, "view", LONGEST_VIEW) };
      }
      only(fields, "pose");
      return { ...head, do: "setView", pose: poseOf(fields.pose) };
    case "takePicture":
      only(fields, "size", "isCaptioned");
      return { ...head, do: "takePicture", ...pictureOf(fields) };
    default:
      throw new RequestError(`there is no request "${String(fields.do).slice(0, LONGEST_ID)}"`);
  }
}

function isRecord(value: unknown): value is Fields {
  return typeof value === "object" && value !== null && !Array.isArray(value);
}

/** Refuses all fields but these and those of every request. */
function only(fields: Fields, ...names: readonly string[]): void {
  refuseOthers(fields, ["trimaran", "id", "do", ...names], "a request");
}

function refuseOthers(fields: Fields, names: readonly string[], what: string): void {
  const other = Object.keys(fields).find((name) => !names.includes(name));
  if (other !== undefined) {
    throw new RequestError(`${what} has no "${other.slice(0, LONGEST_ID)}" here`);
  }
}

function record(value: unknown, name: string, names: readonly string[]): Fields {
  if (!isRecord(value)) {
    throw new RequestError(`"${name}" is an object`);
  }
  refuseOthers(value, names, `"${name}"`);
  return value;
}

function textOf(value: unknown, name: string, longest: number): string {
  if (typeof value !== "string" || value === "" || value.length > longest) {
    throw new RequestError(`"${name}" is a text of 1 to ${longest} letters`);
  }
  return value;
}

function partsOf(value: unknown): readonly PartRef[] {
  if (!Array.isArray(value) || value.length > MOST_PARTS) {
    throw new RequestError(`"parts" is a list of at most ${MOST_PARTS}`);
  }
  return Array.from(value, partOf);
}

function partOf(value: unknown): PartRef {
  const part = record(value, "part", ["name", "object", "group"]);
  const [kind, ...more] = Object.keys(part);
  const number = part[kind ?? ""];
  if (kind === "name" && more.length === 0) {
    return { name: textOf(part.name, "name", LONGEST_NAME) };
  }
  const isNumber = Number.isInteger(number) && Number(number) >= 0 && Number(number) < 2 ** 32;
  if (kind === undefined || more.length > 0 || !isNumber) {
    throw new RequestError('a part has a "name", or the number of an "object" or of a "group"');
  }
  return kind === "object" ? { object: Number(number) } : { group: Number(number) };
}

function poseOf(value: unknown): Pose {
  const { eye, forward, vfovDeg } = record(value, "pose", ["eye", "forward", "vfovDeg"]);
  const pose = { eye: tripleOf(eye, "eye"), forward: tripleOf(forward, "forward"), vfovDeg: Number(vfovDeg) };
  const length = Math.hypot(...pose.forward);
  if (!(length > 1e-6 && length < 1e6)) {
    throw new RequestError('"forward" has a length of about one');
  }
  if (typeof vfovDeg !== "number" || !((vfovDeg >= 20 && vfovDeg <= 100) || isParallel(vfovDeg))) {
    throw new RequestError('"vfovDeg" is a number from 20 to 100, or that of a parallel view');
  }
  return pose;
}

function tripleOf(value: unknown, name: string): Triple {
  const [x, y, z, ...more]: unknown[] = Array.isArray(value) ? value : [];
  if (!isCoordinate(x) || !isCoordinate(y) || !isCoordinate(z) || more.length > 0) {
    throw new RequestError(`"${name}" is three numbers`);
  }
  return [x, y, z];
}

function isCoordinate(value: unknown): value is number {
  return typeof value === "number" && Math.abs(value) <= FARTHEST;
}

function pictureOf({ size, isCaptioned = false }: Fields) {
  if (typeof isCaptioned !== "boolean") {
    throw new RequestError('"isCaptioned" is true or false');
  }
  if (size === undefined) {
    return { isCaptioned };
  }
  const { width, height } = record(size, "size", ["width", "height"]);
  if (typeof width !== "number" || typeof height !== "number") {
    throw new RequestError('"size" has a "width" and a "height" in pixels');
  }
  return { isCaptioned, size: { width, height } };
}
