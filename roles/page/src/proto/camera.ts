/** The camera: the content of the latest lane, and the beginning of a frame. */

import { array, checked, type Of, struct } from "trimaran-transport";

/** Three numbers. */
export const POINT = array("f64", 3);

/** World space is right-handed, in metres. Camera space has x right, y up, and looks down -z. 72 bytes. */
const FIELDS = struct({
  /** Metres, world. */
  eye: POINT,
  /** Camera to world: a unit quaternion x, y, z, w. */
  orientation: array("f64", 4),
  /** Tangent of half the vertical field of view. */
  tanHalfFov: "f32",
  /** The version of the frame's view state. */
  viewState: "u32",
  /** Near distance in metres. */
  near: "f32",
  /** Its frame. */
  frame: "u32",
});

export type Camera = Of<typeof FIELDS>;

export const CAMERA = checked(FIELDS, (camera) => {
  const fault = faultOf(camera);
  return fault && `the camera's ${fault}`;
});

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
