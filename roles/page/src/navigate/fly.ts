/** Moves the eye freely: which way it looks, and how keys and the mouse move it. */

export type Point = [number, number, number];

/** How fast the eye turns with the keys, radians a second. */
const TURN = 1.6;
/** Radians a pixel of the mouse. */
const MOUSE = 0.003;
/** The eye never looks straight up or down: there it has no heading. */
const STEEPEST = Math.PI / 2 - 0.01;
/** Longest step in time, seconds: a page that was in the background does not jump. */
const LONGEST = 0.1;

/** What moves the eye while it is held, by the key's place on the keyboard. */
const KEYS: Readonly<Record<string, readonly [keyof Motion, number]>> = {
  KeyW: ["ahead", 1],
  KeyS: ["ahead", -1],
  KeyD: ["right", 1],
  KeyA: ["right", -1],
  KeyE: ["up", 1],
  KeyQ: ["up", -1],
  Space: ["up", 1],
  KeyC: ["up", -1],
  ArrowLeft: ["turn", 1],
  ArrowRight: ["turn", -1],
  ArrowUp: ["ahead", 1],
  ArrowDown: ["ahead", -1],
  PageUp: ["tilt", 1],
  PageDown: ["tilt", -1],
};

interface Motion {
  ahead: number;
  right: number;
  up: number;
  turn: number;
  tilt: number;
}

export class Fly {
  eye: Point;
  /** Radians: 0 looks along -z, and rises to the left. */
  heading: number;
  /** Radians above the horizon. */
  pitch: number;
  /** Metres a second. */
  speed: number;
  readonly #held = new Set<string>();

  constructor(eye: Point, forward: Point, speed: number) {
    this.eye = [...eye];
    [this.heading, this.pitch] = angles(forward);
    this.speed = speed;
  }

  /** Puts the eye at a place, and lets it look along `forward`. */
  place(eye: Point, forward: Point): void {
    this.eye = [...eye];
    [this.heading, this.pitch] = angles(forward);
  }

  /** Camera to world, a unit quaternion. */
  get orientation(): [number, number, number, number] {
    const [sy, cy] = [Math.sin(this.heading / 2), Math.cos(this.heading / 2)];
    const [sx, cx] = [Math.sin(this.pitch / 2), Math.cos(this.pitch / 2)];
    return [cy * sx, sy * cx, -sy * sx, cy * cx];
  }

  /** Which way the eye looks, a unit vector of the world. */
  get forward(): Point {
    const level = Math.cos(this.pitch);
    return [-Math.sin(this.heading) * level, Math.sin(this.pitch), -Math.cos(this.heading) * level];
  }

  /** A key went down or up. Gives whether it moves the eye. */
  key(code: string, isDown: boolean): boolean {
    if (!(code in KEYS) && !code.startsWith("Shift")) {
      return false;
    }
    if (isDown) {
      this.#held.add(code);
    } else {
      this.#held.delete(code);
    }
    return true;
  }

  /** All keys are up: the page has lost the keyboard. */
  release(): void {
    this.#held.clear();
  }

  /** The mouse was dragged by so many pixels. */
  look(right: number, down: number): void {
    this.heading -= MOUSE * right;
    this.#tilt(-MOUSE * down);
  }

  /** The wheel: faster or slower. */
  hasten(steps: number): void {
    this.speed = Math.min(1000, Math.max(0.01, this.speed * 1.2 ** steps));
  }

  /** Moves for so many seconds. Gives whether the eye has moved. */
  step(seconds: number): boolean {
    const motion: Motion = { ahead: 0, right: 0, up: 0, turn: 0, tilt: 0 };
    for (const code of this.#held) {
      const [way, sign] = KEYS[code] ?? ["ahead", 0];
      motion[way] += sign;
    }
    if (Object.values(motion).every((part) => part === 0)) {
      return false;
    }
    const time = Math.min(seconds, LONGEST);
    const isFast = this.#held.has("ShiftLeft") || this.#held.has("ShiftRight");
    const way = this.speed * time * (isFast ? 4 : 1);
    const [sin, cos] = [Math.sin(this.heading), Math.cos(this.heading)];
    this.heading += TURN * time * motion.turn;
    this.#tilt(TURN * time * motion.tilt);
    this.eye[0] += way * (-sin * motion.ahead + cos * motion.right);
    this.eye[1] += way * motion.up;
    this.eye[2] += way * (-cos * motion.ahead - sin * motion.right);
    return true;
  }

  #tilt(by: number): void {
    this.pitch = Math.min(STEEPEST, Math.max(-STEEPEST, this.pitch + by));
  }
}

/** Heading and pitch of a direction. */
function angles(forward: Point): [number, number] {
  const up = forward[1] / (Math.hypot(...forward) || 1);
  const pitch = Math.asin(Math.max(-1, Math.min(1, up)));
  return [Math.atan2(-forward[0], -forward[2]), Math.max(-STEEPEST, Math.min(STEEPEST, pitch))];
}
