/** Which way a person looks. */

export type Point = [number, number, number];

/** The eye never looks straight up or down: there it has no heading. */
const STEEPEST = Math.PI / 2 - 0.01;

export class Gaze {
  /** Radians: 0 looks along -z, and rises to the left. */
  heading = 0;
  /** Radians above the horizon. */
  pitch = 0;

  constructor(forward: Readonly<Point>) {
    this.along(forward);
  }

  /** Looks along a direction of the world, of any length. */
  along(forward: Readonly<Point>): void {
    const up = forward[1] / (Math.hypot(...forward) || 1);
    this.heading = Math.atan2(-forward[0], -forward[2]);
    this.pitch = 0;
    this.turn(0, Math.asin(Math.max(-1, Math.min(1, up))));
  }

  /** Turns by so many radians to the left, and upwards. */
  turn(left: number, up: number): void {
    this.heading += left;
    this.pitch = Math.min(STEEPEST, Math.max(-STEEPEST, this.pitch + up));
  }

  /** Camera to world, a unit quaternion. */
  get orientation(): [number, number, number, number] {
    return orientationOf(this.heading, this.pitch);
  }

  /** Which way the eye looks, a unit vector of the world. */
  get forward(): Point {
    const level = Math.cos(this.pitch);
    return [-Math.sin(this.heading) * level, Math.sin(this.pitch), -Math.cos(this.heading) * level];
  }

  /** Where on the ground one goes who goes so far ahead and to the right: x and z. */
  onGround(ahead: number, right: number): [number, number] {
    const [sin, cos] = [Math.sin(this.heading), Math.cos(this.heading)];
    return [-sin * ahead + cos * right, -cos * ahead - sin * right];
  }
}

/** Camera to world of who looks there, a unit quaternion. */
export function orientationOf(heading: number, pitch: number): [number, number, number, number] {
  const [sy, cy] = [Math.sin(heading / 2), Math.cos(heading / 2)];
  const [sx, cx] = [Math.sin(pitch / 2), Math.cos(pitch / 2)];
  return [cy * sx, sy * cx, -sy * sx, cy * cx];
}
