/** A person's pose in the scene, and how input changes it. */

import { signal } from "@preact/signals";
import { Projection } from "../draw/projection.ts";
import type { SceneDescription, Service, Side } from "../service/service.ts";
import { type Box, centreOf } from "../space/box.ts";
import { beyond, distance, type Point } from "../space/point.ts";
import { CameraHistory, type CameraPose } from "./cameraHistory.ts";
import { Flight, type Sight } from "./flight.ts";
import { framingEye } from "./framing.ts";
import { Gaze } from "./gaze.ts";
import { Ground } from "./ground.ts";
import { addGamepad, Keys, type Motion, still } from "./motion.ts";
import { type Axes, approach, axesOf, pan, turnAbout } from "./orbit.ts";
import { type Drag, listenToPointers } from "./pointers.ts";
import { mostOpen } from "./sides.ts";
import { isForControl } from "./typing.ts";
import { Walk } from "./walk.ts";

/** On the ground, freely through everything, or around the point under the pointer. */
export const MODES = ["walk", "fly", "orbit"] as const;
export type Mode = (typeof MODES)[number];

/** How fast the eye turns with the keys, radians a second. */
const TURN = 1.6;
/** Radians a pixel of the mouse, for looking around and for orbiting. */
const MOUSE = 0.003;
const ORBIT = 0.006;
/** Pixels of a two-finger drag that move a person by the height of the eye. */
const PUSH = 150;
/** The share of the distance that a wheel step covers. */
const DOLLY = 0.15;
/** CSS pixels around the pointer to search if nothing is right under it. */
const AROUND = 8;
/** The smallest distance to an approached point, as a share of the height of the eye. */
const CLOSEST = 0.005;
/** Points nearer than this are not in the picture, metres. */
const NEAREST = 1e-9;
/** Longest step in time, seconds: a page that was in the background does not jump. */
const LONGEST = 0.1;
/** The same for a flight, which is to arrive in time though pictures are slow. */
const LONGEST_FLOWN = 0.25;
/** Running speed factor. */
const FASTER = 4;
/** Metres a second, of a person whose eye is at 1.7 m. */
const STROLL = 1.4 / 1.7;
/** Vertical fields of view, degrees. */
const NARROWEST = 20;
const WIDEST = 100;

/** A flight, and what it waits for. */
interface Flown {
  readonly flight: Flight;
  /** The mode after it. */
  readonly mode: Mode;
  readonly isReady: () => boolean;
}

/** The commands of keys. */
const COMMANDS: Readonly<Record<string, (navigator: Navigator) => void>> = {
  Digit1: (navigator) => navigator.setMode("walk"),
  Digit2: (navigator) => navigator.setMode("fly"),
  Digit3: (navigator) => navigator.setMode("orbit"),
  Minus: (navigator) => navigator.setVfov(navigator.vfovDeg + 5),
  Equal: (navigator) => navigator.setVfov(navigator.vfovDeg - 5),
};

export class Navigator {
  readonly #gaze: Gaze;
  readonly #keys = new Keys();
  readonly #ground: Ground;
  readonly #walk: Walk;
  /** Metres, world. */
  eye: Point;
  /** How far two fingers have moved the person since the last step: forward and right, metres. */
  #pushed: [number, number] = [0, 0];
  /** The point to orbit: the last one pointed at or framed, at first the middle of the model. */
  #pivot: Point;
  /** The point that the wheel approaches, as long as it stays at the pointer. */
  #zoomed: Point | undefined;
  readonly #canvas: HTMLCanvasElement;
  /** The middle of the model. */
  readonly #middle: Point;
  /** Height of the eye above floors, which sets the scale of the scene. */
  readonly #scale: number;
  /** The visible point at a place of the canvas, or within `around` of it. CSS pixels. */
  pointAt: (x: number, y: number, around: number) => Point | undefined = () => undefined;
  readonly mode = signal<Mode>("walk");
  /** Vertical field of view, degrees. */
  readonly vfov = signal(0);
  /** Metres a second. */
  readonly speed = signal(0);
  /** The places between which a person has jumped. */
  readonly history = new CameraHistory();
  /** The flight under way. */
  #flown: Flown | undefined;
  /** Keys and mouse do nothing. */
  isHeld = false;
  /** Whether the eye was moved since the last step. */
  isMoved = true;
  #hasJumped = true;

  constructor(canvas: HTMLCanvasElement, scene: SceneDescription, service: Pick<Service, "tile">) {
    const { eye, forward } = scene.start;
    this.eye = eye;
    this.#canvas = canvas;
    this.#middle = centreOf(scene.core);
    this.#pivot = this.#middle;
    this.#scale = scene.eyeHeight;
    this.#gaze = new Gaze(forward);
    this.#ground = new Ground(service, scene.tileSide);
    this.#walk = new Walk(this.eye, scene.eyeHeight);
    this.mode.value = scene.hasFloors ? "walk" : "fly";
    this.vfov.value = scene.vfovDeg;
    this.speed.value = STROLL * scene.eyeHeight;
    this.#listen(canvas);
  }

  /** Camera to world, a unit quaternion. */
  get orientation(): [number, number, number, number] {
    return this.#gaze.orientation;
  }

  /** The viewing direction, a unit vector of the world. */
  get forward(): Point {
    return this.#gaze.forward;
  }

  /** The directions to the right, upwards and ahead: unit vectors of the world. */
  get axes(): Axes {
    return axesOf(this.#gaze);
  }

  /** The eye and the viewing direction: see `Gaze`. */
  get pose(): { eye: Point; heading: number; pitch: number } {
    return { eye: this.eye, heading: this.#gaze.heading, pitch: this.#gaze.pitch };
  }

  /** Metres from the eye to the orbited point; in walk mode there is none. */
  get reach(): number {
    return this.mode.peek() === "walk" ? Number.POSITIVE_INFINITY : distance(this.eye, this.#pivot);
  }

  /** Tangent of half the vertical field of view. */
  get tanHalfFov(): number {
    return Math.tan((this.vfovDeg * Math.PI) / 360);
  }

  /** Vertical field of view, degrees. */
  get vfovDeg(): number {
    return this.vfov.peek();
  }

  /** Moves for this many seconds. Returns whether the eye has moved since the last step. */
  step(seconds: number): boolean {
    const isStep = this.#advance(seconds) || (!this.isHeld && this.#move(Math.min(seconds, LONGEST)));
    const hasMoved = this.isMoved || isStep;
    this.isMoved = false;
    return hasMoved;
  }

  setMode(mode: Mode): void {
    this.mode.value = mode;
    this.#walk.place(this.eye);
  }

  setVfov(degrees: number): void {
    this.vfov.value = Math.max(NARROWEST, Math.min(WIDEST, degrees));
    this.isMoved = true;
  }

  /** Releases all keys: other elements have the keyboard. */
  release(): void {
    this.#keys.release();
  }

  /** Presses or releases the key of that code, if it moves the eye. */
  press(code: string, isDown: boolean): void {
    this.#keys.press(code, isDown);
  }

  /** Increases the speed by this many steps. */
  hasten(steps: number): void {
    this.speed.value = Math.min(1000, Math.max(0.01, this.speed.peek() * 1.2 ** steps));
  }

  /** Whether the eye has jumped since the last call. */
  hasJumped(): boolean {
    const hasJumped = this.#hasJumped;
    this.#hasJumped = false;
    return hasJumped;
  }

  /** Puts the eye at a place, looking along `forward`. Earlier taps and drags are discarded. */
  goTo(eye: Point, forward: Point): void {
    this.#hasJumped = true;
    this.#zoomed = undefined;
    this.#pushed = [0, 0];
    this.#keys.forget();
    this.follow(eye, forward);
  }

  /** The same, but as a step of a continuous motion. */
  follow(eye: Point, forward: Point): void {
    this.#flown = undefined;
    this.#put({ eye, forward });
  }

  /** Jumps to a pose. `goBack` returns to this place. */
  jumpTo(pose: CameraPose): void {
    this.history.leave(this.#cameraPose);
    this.#show(pose);
  }

  /** Returns to the place before the last jump, or with 1 to the one after it. */
  goBack(steps: -1 | 1 = -1): void {
    const pose = this.history.go(steps, this.#cameraPose);
    if (pose !== undefined) {
      this.#show(pose);
    }
  }

  /**
   * Jumps to where a box fills the picture, and looks at it: from the present side and a little above, or
   * from a more open side.
   */
  frame(box: Box, sides: readonly Side[] = []): void {
    const { forward } = this;
    const level = Math.hypot(forward[0], forward[2]) || 1;
    const ahead: Point = [(0.9 * forward[0]) / level, -0.44, (0.9 * forward[2]) / level];
    this.frameFrom(box, mostOpen(sides, ahead) ?? ahead);
  }

  /** Jumps to where a box fills the picture, and looks at it along `forward`. */
  frameFrom(box: Box, forward: Point): void {
    this.history.leave(this.#cameraPose);
    this.show(box, forward);
  }

  /** The same, without a way back. */
  show(box: Box, forward: Point): void {
    const gaze = new Gaze(forward);
    if (this.mode.peek() === "walk") {
      this.mode.value = "fly";
    }
    const { width, height } = this.#size;
    const { tanHalfFov } = this;
    this.goTo(framingEye(box, gaze, (tanHalfFov * width) / height, tanHalfFov), gaze.forward);
    this.#pivot = centreOf(box);
  }

  /**
   * Flies to a pose within this many seconds, once `isReady`, and is in `mode` then. Any input and any other
   * motion ends the flight where it is.
   */
  fly(to: Sight, mode: Mode, seconds: number, isReady: () => boolean): void {
    const flight = new Flight({ eye: this.eye, forward: this.forward }, to, seconds);
    this.#flown = { flight, mode, isReady };
  }

  get #cameraPose(): CameraPose {
    const { eye, forward, vfovDeg } = this;
    return { eye, forward, vfovDeg, mode: this.mode.peek() };
  }

  #show({ eye, forward, vfovDeg, mode }: CameraPose): void {
    this.setMode(mode);
    this.setVfov(vfovDeg);
    this.goTo(eye, forward);
  }

  #put({ eye, forward }: Sight): void {
    this.eye = eye;
    this.#gaze.along(forward);
    this.#walk.place(eye);
    this.isMoved = true;
  }

  /** Flies on. Returns whether the eye has moved by that. */
  #advance(seconds: number): boolean {
    const flown = this.#flown;
    if (flown === undefined || (!flown.flight.hasBegun && !flown.isReady())) {
      return false;
    }
    const pushed = still();
    addGamepad(pushed, navigator.getGamepads());
    if (Object.values(pushed).some((share) => share !== 0)) {
      this.#flown = undefined;
      return false;
    }
    this.#put(flown.flight.after(Math.min(seconds, LONGEST_FLOWN)));
    if (flown.flight.isOver) {
      this.#flown = undefined;
      this.setMode(flown.mode);
    }
    return true;
  }

  #move(seconds: number): boolean {
    const motion = still();
    this.#keys.add(motion);
    addGamepad(motion, navigator.getGamepads());
    if (motion.turn !== 0 || motion.tilt !== 0) {
      this.#gaze.turn(TURN * seconds * motion.turn, TURN * seconds * motion.tilt);
      this.isMoved = true;
    }
    const way = this.speed.peek() * seconds * (this.#keys.isFast ? FASTER : 1);
    return this.mode.peek() === "walk" ? this.#stride(seconds, way, motion) : this.#glide(way, motion);
  }

  #stride(seconds: number, way: number, motion: Motion): boolean {
    this.#ground.fetchAround(this.eye[0], this.eye[2]);
    if (motion.up > 0) {
      this.#walk.jump();
    }
    const [ahead, right] = this.#pushed;
    this.#pushed = [0, 0];
    const [x, z] = this.#gaze.onGround(way * motion.ahead + ahead, way * motion.right + right);
    const isMoved = this.#walk.step(seconds, x, z, this.#ground);
    this.eye = this.#walk.eye;
    return isMoved;
  }

  #glide(way: number, { ahead, right, up }: Motion): boolean {
    const [x, z] = this.#gaze.onGround(way * ahead, way * right);
    this.eye = [this.eye[0] + x, this.eye[1] + way * up, this.eye[2] + z];
    return ahead !== 0 || right !== 0 || up !== 0;
  }

  #drag({ right, down, isPan, spread }: Drag, height: number): void {
    if (this.isHeld) {
      return;
    }
    this.isMoved = true;
    const isOrbit = this.mode.peek() === "orbit";
    if (isPan && this.mode.peek() === "walk") {
      // Two fingers push the ground away, like hands on a rail.
      const each = this.#scale / PUSH;
      this.#pushed = [this.#pushed[0] + down * each, this.#pushed[1] - right * each];
    } else if (isPan) {
      const depth = Math.max(this.#projection.depthOf(this.#pivot), CLOSEST * this.#scale);
      const each = (2 * depth * this.tanHalfFov) / height;
      this.eye = pan(this.eye, this.#gaze, -right * each, down * each);
      this.#approach(1 - 1 / spread);
    } else if (isOrbit) {
      this.eye = turnAbout(this.#pivot, this.eye, this.#gaze, -ORBIT * right, -ORBIT * down);
    } else {
      this.#gaze.turn(MOUSE * right, MOUSE * down);
    }
  }

  /** Begins to orbit the point there. On the background the old pivot stays if it is visible. */
  #hold(x: number, y: number): void {
    this.#zoomed = undefined;
    const held = this.pointAt(x, y, AROUND);
    if (held !== undefined || !this.#projection.shows(this.#pivot)) {
      const { clientWidth, clientHeight } = this.#canvas;
      this.#pivot = held ?? this.pointAt(clientWidth / 2, clientHeight / 2, AROUND) ?? this.#ahead();
    }
  }

  /** The middle of the model if it is visible, or else the point as far ahead. */
  #ahead(): Point {
    const middle = this.#middle;
    const way = distance(this.eye, middle);
    return this.#projection.shows(middle) ? middle : beyond(this.eye, this.forward, way);
  }

  /**
   * Approaches the visible point at a place of the canvas, or moves away from it. The point stays there. On
   * the background, the orbited point is approached.
   */
  #zoom(x: number, y: number, share: number): void {
    const projection = this.#projection;
    const zoomed = this.#zoomed && projection.place(this.#zoomed);
    if (zoomed === undefined || Math.hypot(zoomed.x - x, zoomed.y - y) > AROUND + 1) {
      this.#zoomed = this.pointAt(x, y, AROUND);
    }
    this.#pivot = this.#zoomed ?? (projection.shows(this.#pivot) ? this.#pivot : this.#ahead());
    this.#approach(share);
  }

  /** Covers a share of the distance to the orbited point. */
  #approach(share: number): void {
    this.eye = approach(this.#pivot, this.eye, share, CLOSEST * this.#scale);
    this.isMoved = true;
  }

  /** The size of the canvas in CSS pixels. */
  get #size(): { width: number; height: number } {
    const { clientWidth, clientHeight } = this.#canvas;
    return { width: Math.max(1, clientWidth), height: Math.max(1, clientHeight) };
  }

  get #projection(): Projection {
    const { eye, orientation, tanHalfFov } = this;
    const { width, height } = this.#size;
    return new Projection({ eye, orientation, tanHalfFov, near: NEAREST }, width, height);
  }

  #listen(canvas: HTMLCanvasElement): void {
    for (const kind of ["keydown", "pointerdown", "wheel"] as const) {
      const end = () => {
        this.#flown = undefined;
      };
      addEventListener(kind, end, { capture: true, passive: true });
    }
    addEventListener("keydown", (event) => {
      const isShortcut = event.ctrlKey || event.metaKey || event.altKey;
      if (
        !isShortcut &&
        !isForControl(event) &&
        (this.#keys.press(event.code, true) || this.#command(event.code))
      ) {
        event.preventDefault();
      }
    });
    addEventListener("keyup", (event) => this.#keys.press(event.code, false));
    addEventListener("blur", () => this.release());
    listenToPointers(
      canvas,
      (x, y) => this.#hold(x, y),
      (drag) => this.#drag(drag, canvas.clientHeight),
    );
    canvas.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        if (this.mode.peek() === "orbit") {
          this.#zoom(event.offsetX, event.offsetY, DOLLY * -Math.sign(event.deltaY));
        } else {
          this.hasten(-Math.sign(event.deltaY));
        }
      },
      { passive: false },
    );
  }

  /** Runs the command of a key. Returns whether it has one. */
  #command(code: string): boolean {
    const command = COMMANDS[code];
    command?.(this);
    return command !== undefined;
  }
}
