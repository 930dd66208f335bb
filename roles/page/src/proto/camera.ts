/** The camera: the content of the latest lane, and the beginning of a frame. */

import type { Point } from "../space/point.ts";
import { Reader, WireError, Writer } from "../wire/bytes.ts";

/** World space is right-handed, in metres. Camera space has x right, y up, and looks down -z. */
export interface Camera {
  /** Metres, world. */
  readonly eye: Point;
  /** Camera to world: a unit quaternion x, y, z, w. */
  readonly orientation: readonly [number, number, number, number];
  /** Tangent of half the vertical field of view. Sent as f32. */
  readonly tanHalfFov: number;
  /** The version of the frame's view state. */
  readonly viewState: number;
  /** Near distance in metres. Sent as f32. */
  readonly near: number;
  /** Its frame. */
  readonly frame: number;
}

/** Encodes a camera as 72 bytes. */
export function encodeCamera(camera: Camera): Uint8Array<ArrayBuffer> {
  const writer = new Writer();
  for (const coordinate of [...camera.eye, ...camera.orientation]) {
    writer.f64(coordinate);
  }
  writer.f32(camera.tanHalfFov).u32(camera.viewState);
  return writer.f32(camera.near).u32(camera.frame).take();
}

/** Reads a camera. Throws a `WireError` if it is invalid. */
export function decodeCamera(bytes: Uint8Array): Camera {
  const reader = new Reader(bytes);
  const camera: Camera = {
    eye: [reader.f64(), reader.f64(), reader.f64()],
    orientation: [reader.f64(), reader.f64(), reader.f64(), reader.f64()],
    tanHalfFov: reader.f32(),
    viewState: reader.u32(),
    near: reader.f32(),
    frame: reader.u32(),
  };
  reader.end();
  const fault = faultOf(camera);
  if (fault !== undefined) {
    throw new WireError(`the camera's ${fault}`);
  }
  return camera;
}

function faultOf({ eye, orientation, tanHalfFov, near }: Camera): string | undefined {
  const lengthSquared = orientation.reduce((sum, coordinate) => sum + coordinate * coordinate, 0);
  if (!eye.every(Number.isFinite)) {
    return "eye is not finite";
  }
  if (!(Math.abs(lengthSquared - 1) <= 2e-6)) {
    return "orientation is not a unit quaternion";
  }
  // The bounds are f32 as well: 1e-5 is not exactly one.
  if (!(tanHalfFov >= Math.fround(1e-5) && tanHalfFov <= 1e5)) {
    return "vertical field of view is outside 0.00115 to 179.99885 degrees";
  }
  if (!(Number.isFinite(near) && near > Math.fround(1e-30))) {
    return "near distance is not a positive finite number";
  }
  return undefined;
}
