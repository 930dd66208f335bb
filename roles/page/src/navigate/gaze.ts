/** The viewing direction. */

import type { Point } from "../space/point.ts";

/**
 * The eye never looks straight up or down: there it has no heading. A plan is so near to it that walls of ten
 * metres lean by ten micrometres.
 */
const STEEPEST = Math.PI / 2 - 1e-6;

export class Gaze {
  /** Radians: 0 looks along -z; increases to the left. */
  heading = 0;
  /** Radians above the horizon. */
  pitch = 0;

  constructor(forward: Point) {
    this.along(forward);
  }

  /** Looks along a direction of the world, of any length. */
  along(forward: Point): void {
    this.heading = Math.atan2(-forward[0], -forward[2]);
    this.pitch = 0;
    this.turn(0, Math.atan2(forward[1], Math.hypot(forward[0], forward[2])));
  }

  /** Turns by this many radians to the left, and upwards. */
  turn(left: number, up: number): void {
    this.heading += left;
    this.pitch = Math.min(STEEPEST, Math.max(-STEEPEST, this.pitch + up));
  }

  /** Camera to world, a unit quaternion. */
  get orientation(): [number, number, number, number] {
    return orientationOf(this.heading, this.pitch);
  }

  /** The viewing direction, a unit vector of the world. */
  get forward(): Point {
    return directionOf(this.heading, this.pitch);
  }

  /** Converts forward and right steps to world x, z. */
  onGround(ahead: number, right: number): [number, number] {
    const [sin, cos] = [Math.sin(this.heading), Math.cos(this.heading)];
    return [-sin * ahead + cos * right, -cos * ahead - sin * right];
  }
}

/** The camera-to-world rotation for a heading and pitch, a unit quaternion. */
export function orientationOf(heading: number, pitch: number): [number, number, number, number] {
  const [sy, cy] = [Math.sin(heading / 2), Math.cos(heading / 2)];
  const [sx, cx] = [Math.sin(pitch / 2), Math.cos(pitch / 2)];
  return [cy * sx, sy * cx, -sy * sx, cy * cx];
}

/** The viewing direction for a heading and pitch, a unit vector of the world. */
export function directionOf(heading: number, pitch: number): Point {
  const level = Math.cos(pitch);
  return [-Math.sin(heading) * level, Math.sin(pitch), -Math.cos(heading) * level];
}

/** The viewing direction of a camera-to-world rotation. */
export function forwardOf([x, y, z, w]: readonly [number, number, number, number]): Point {
  return [-2 * (x * z + w * y), -2 * (y * z - w * x), -(1 - 2 * (x * x + y * y))];
}
