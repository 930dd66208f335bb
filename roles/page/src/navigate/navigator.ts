/** Where a person is in the scene, and what moves them there. */

import { signal } from "@preact/signals";
import type { SceneDescription, Service } from "../service/service.ts";
import { Gaze, type Point } from "./gaze.ts";
import { Ground } from "./ground.ts";
import { addGamepad, Keys, type Motion, still } from "./motion.ts";
import { approach, pan, turnAbout } from "./orbit.ts";
import { type Drag, listenToPointers } from "./pointers.ts";
import { isTyping } from "./typing.ts";
import { Walk } from "./walk.ts";

/** On the ground, freely through everything, or round what is pointed at. */
export type Mode = "walk" | "fly" | "orbit";

/** How fast the eye turns with the keys, radians a second. */
const TURN = 1.6;
/** Radians a pixel of the mouse: where the eye looks about, and where it goes round a point. */
const MOUSE = 0.003;
const ORBIT = 0.006;
/** Pixels by which two fingers push a person by the height of the eye. */
const PUSH = 150;
/** The share of the way that a step of the wheel goes. */
const DOLLY = 0.15;
/** Longest step in time, seconds: a page that was in the background does not jump. */
const LONGEST = 0.1;
/** Who runs is so much faster. */
const FASTER = 4;
/** Metres a second, of a person whose eye is at 1.7 m. */
const STROLL = 1.4 / 1.7;
/** Vertical fields of view, degrees. */
const NARROWEST = 20;
const WIDEST = 100;

export class Navigator {
  readonly #gaze: Gaze;
  readonly #keys = new Keys();
  readonly #ground: Ground;
  readonly #walk: Walk;
  #eye: Point;
  /** How far two fingers have pushed the person since the last step: ahead and to the right, metres. */
  #pushed: [number, number] = [0, 0];
  /** What is dragged round. */
  #pivot: Readonly<Point> | undefined;
  /** Height of the eye above floors: how large things are here. */
  readonly #scale: number;
  /** Tells which point shows at a place of the canvas, in CSS pixels. */
  pointAt: (x: number, y: number) => Readonly<Point> | undefined = () => undefined;
  readonly mode = signal<Mode>("walk");
  /** Vertical field of view, degrees. */
  readonly vfov = signal(0);
  /** Metres a second. */
  readonly speed = signal(0);
  /** Keys and mouse do nothing. */
  isHeld = false;
  /** Something has moved the eye since the last step. */
  #hasMoved = true;
  #hasJumped = true;

  constructor(canvas: HTMLCanvasElement, scene: SceneDescription, service: Pick<Service, "tile">) {
    const { eye, forward } = scene.start;
    this.#eye = [...eye];
    this.#scale = scene.eyeHeight;
    this.#gaze = new Gaze([...forward]);
    this.#ground = new Ground(service, scene.tileSide);
    this.#walk = new Walk(this.#eye, scene.eyeHeight);
    this.mode.value = scene.hasFloors ? "walk" : "fly";
    this.vfov.value = scene.vfovDeg;
    this.speed.value = STROLL * scene.eyeHeight;
    this.#listen(canvas);
  }

  get eye(): Readonly<Point> {
    return this.#eye;
  }

  /** Camera to world, a unit quaternion. */
  get orientation(): [number, number, number, number] {
    return this.#gaze.orientation;
  }

  /** Which way the eye looks, a unit vector of the world. */
  get forward(): Point {
    return this.#gaze.forward;
  }

  /** The eye, and which way it looks: see `Gaze`. */
  get pose(): { eye: Readonly<Point>; heading: number; pitch: number } {
    return { eye: this.#eye, heading: this.#gaze.heading, pitch: this.#gaze.pitch };
  }

  /** Vertical field of view, degrees. */
  get vfovDeg(): number {
    return this.vfov.peek();
  }

  /** Moves for so many seconds. Gives whether the eye has moved since the last step. */
  step(seconds: number): boolean {
    const isMoved = !this.isHeld && this.#move(Math.min(seconds, LONGEST));
    const hasMoved = this.#hasMoved || isMoved;
    this.#hasMoved = false;
    return hasMoved;
  }

  setMode(mode: Mode): void {
    this.mode.value = mode;
    this.#walk.place(this.#eye);
  }

  setVfov(degrees: number): void {
    this.vfov.value = Math.max(NARROWEST, Math.min(WIDEST, degrees));
    this.#hasMoved = true;
  }

  /** Faster by so many steps. */
  hasten(steps: number): void {
    this.speed.value = Math.min(1000, Math.max(0.01, this.speed.peek() * 1.2 ** steps));
  }

  /** Whether the eye is elsewhere without having gone there, since this was asked. */
  hasJumped(): boolean {
    const hasJumped = this.#hasJumped;
    this.#hasJumped = false;
    return hasJumped;
  }

  /** Puts the eye at a place, and lets it look along `forward`. */
  goTo(eye: Readonly<Point>, forward: Readonly<Point>): void {
    this.#hasJumped = true;
    this.follow(eye, forward);
  }

  /** The same, but as a step of a way that goes on. */
  follow(eye: Readonly<Point>, forward: Readonly<Point>): void {
    this.#eye = [...eye];
    this.#gaze.along(forward);
    this.#walk.place(eye);
    this.#hasMoved = true;
  }

  /** Flies to where a box, given by its corners, fills about half of the picture, and looks at it. */
  frame(min: Readonly<Point>, max: Readonly<Point>): void {
    const centre: Point = [(min[0] + max[0]) / 2, (min[1] + max[1]) / 2, (min[2] + max[2]) / 2];
    const radius = Math.hypot(max[0] - min[0], max[1] - min[1], max[2] - min[2]) / 2;
    const distance = Math.max(radius, 1e-3) / Math.sin((this.vfovDeg * Math.PI) / 720);
    // From the side from which it is seen now, and from a little above.
    const [right, , back] = this.forward;
    const level = Math.hypot(right, back) || 1;
    const forward: Point = [(0.9 * right) / level, -0.44, (0.9 * back) / level];
    const at = (axis: 0 | 1 | 2) => centre[axis] - (forward[axis] * distance) / Math.hypot(...forward);
    if (this.mode.peek() === "walk") {
      this.mode.value = "fly";
    }
    this.goTo([at(0), at(1), at(2)], forward);
  }

  #move(seconds: number): boolean {
    const motion = still();
    this.#keys.add(motion);
    addGamepad(motion, navigator.getGamepads());
    if (motion.turn !== 0 || motion.tilt !== 0) {
      this.#gaze.turn(TURN * seconds * motion.turn, TURN * seconds * motion.tilt);
      this.#hasMoved = true;
    }
    const way = this.speed.peek() * seconds * (this.#keys.isFast ? FASTER : 1);
    return this.mode.peek() === "walk" ? this.#stride(seconds, way, motion) : this.#glide(way, motion);
  }

  #stride(seconds: number, way: number, motion: Motion): boolean {
    this.#ground.fetchAround(this.#eye[0], this.#eye[2]);
    if (motion.up > 0) {
      this.#walk.jump();
    }
    const [ahead, right] = this.#pushed;
    this.#pushed = [0, 0];
    const [x, z] = this.#gaze.onGround(way * motion.ahead + ahead, way * motion.right + right);
    const isMoved = this.#walk.step(seconds, x, z, this.#ground);
    this.#eye = this.#walk.eye;
    return isMoved;
  }

  #glide(way: number, { ahead, right, up }: Motion): boolean {
    const [x, z] = this.#gaze.onGround(way * ahead, way * right);
    this.#eye = [this.#eye[0] + x, this.#eye[1] + way * up, this.#eye[2] + z];
    return ahead !== 0 || right !== 0 || up !== 0;
  }

  #drag({ right, down, isPan, spread }: Drag, height: number): void {
    if (this.isHeld) {
      return;
    }
    this.#hasMoved = true;
    const isOrbit = this.mode.peek() === "orbit";
    const pivot = this.#pivot;
    if (isPan && this.mode.peek() === "walk") {
      // Two fingers push the ground away, as hands on a rail would.
      const each = this.#scale / PUSH;
      this.#pushed = [this.#pushed[0] + down * each, this.#pushed[1] - right * each];
    } else if (isPan) {
      const depth = pivot === undefined ? this.#scale : this.#depthOf(pivot);
      const each = (2 * depth * Math.tan((this.vfovDeg * Math.PI) / 360)) / height;
      this.#eye = pan(this.#eye, this.#gaze, -right * each, down * each);
      this.#approach(1 - 1 / spread);
    } else if (isOrbit && pivot !== undefined) {
      this.#eye = turnAbout(pivot, this.#eye, this.#gaze, -ORBIT * right, -ORBIT * down);
    } else {
      this.#gaze.turn(MOUSE * right, MOUSE * down);
    }
  }

  /** Goes a share of the way to the pivot, or ahead. */
  #approach(share: number): void {
    const [x, y, z] = this.forward;
    const way = 4 * this.#scale;
    const ahead: Point = [this.#eye[0] + way * x, this.#eye[1] + way * y, this.#eye[2] + way * z];
    this.#eye = approach(this.#pivot ?? ahead, this.#eye, share);
    this.#hasMoved = true;
  }

  /** Metres along the gaze. */
  #depthOf(point: Readonly<Point>): number {
    const { forward } = this;
    const [x, y, z] = [point[0] - this.#eye[0], point[1] - this.#eye[1], point[2] - this.#eye[2]];
    return Math.max(x * forward[0] + y * forward[1] + z * forward[2], 0.1 * this.#scale);
  }

  #listen(canvas: HTMLCanvasElement): void {
    addEventListener("keydown", (event) => {
      const isForOthers = event.ctrlKey || event.metaKey || event.altKey || isTyping(event.target);
      if (!isForOthers && (this.#keys.press(event.code, true) || this.#command(event.code))) {
        event.preventDefault();
      }
    });
    addEventListener("keyup", (event) => this.#keys.press(event.code, false));
    addEventListener("blur", () => this.#keys.release());
    const begin = (x: number, y: number) => {
      this.#pivot = this.pointAt(x, y);
    };
    listenToPointers(canvas, begin, (drag) => this.#drag(drag, canvas.clientHeight));
    canvas.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        if (this.mode.peek() === "orbit") {
          this.#pivot = this.pointAt(event.offsetX, event.offsetY) ?? this.#pivot;
          this.#approach(DOLLY * -Math.sign(event.deltaY));
        } else {
          this.hasten(-Math.sign(event.deltaY));
        }
      },
      { passive: false },
    );
  }

  /** What a key does once. Gives whether it does anything. */
  #command(code: string): boolean {
    switch (code) {
      case "Digit1":
        this.setMode("walk");
        return true;
      case "Digit2":
        this.setMode("fly");
        return true;
      case "Digit3":
        this.setMode("orbit");
        return true;
      case "Minus":
        this.setVfov(this.vfovDeg + 5);
        return true;
      case "Equal":
        this.setVfov(this.vfovDeg - 5);
        return true;
      default:
        return false;
    }
  }
}
