/** A person's pose in the scene, and how input changes it. */

import { computed, signal } from "@preact/signals";
import { Projection } from "../draw/projection.ts";
import type { SceneDescription, Service, Side } from "../service/service.ts";
import { type Box, centreOf, cornersOf, sizeOf } from "../space/box.ts";
import { beyond, distance, type Point } from "../space/point.ts";
import { CameraHistory, type CameraPose } from "./cameraHistory.ts";
import { Flight, type Sight } from "./flight.ts";
import { framingEye } from "./framing.ts";
import { Gaze } from "./gaze.ts";
import { Ground } from "./ground.ts";
import { addGamepad, Keys, type Motion, still } from "./motion.ts";
import { type Axes, approach, axesOf, pan, turnAbout } from "./orbit.ts";
import { isParallel, PARALLEL_DEG, type ProjectionKind, tanOfHalf } from "./parallel.ts";
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
/** In parallel: the highest picture in diagonals of the model, and the heights that keys pan by in a second. */
const HIGHEST = 30;
const PACE = 0.5;
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
  KeyR: (navigator) => navigator.toggleProjection(),
  Minus: (navigator) => navigator.widen(5),
  Equal: (navigator) => navigator.widen(-5),
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
  /**
   * The point to orbit: the last one pointed at or framed, at first the middle of the model. After a jump in
   * parallel there is none until it is needed.
   */
  #pivot: Point | undefined;
  /** The point that the wheel approaches, as long as it stays at the pointer. */
  #zoomed: Point | undefined;
  readonly #canvas: HTMLCanvasElement;
  readonly #scene: Pick<SceneDescription, "core" | "outermost">;
  /** The middle of the model. */
  readonly #middle: Point;
  /** Metres from one end of the model to the other. */
  readonly #diagonal: number;
  /** Height of the eye above floors, which sets the scale of the scene. */
  readonly #scale: number;
  /** The visible point at a place of the canvas, or within `around` of it. CSS pixels. */
  pointAt: (x: number, y: number, around: number) => Point | undefined = () => undefined;
  readonly mode = signal<Mode>("walk");
  /** Vertical field of view, degrees. */
  readonly vfov = signal(0);
  /** Parallel is one field of view: see `parallel.ts`. In it, the mode is orbit. */
  readonly projection = computed<ProjectionKind>(() =>
    isParallel(this.vfov.value) ? "parallel" : "perspective",
  );
  /** The field of view of perspective, degrees. */
  #lens: number;
  /** Metres a second. */
  readonly speed = signal(0);
  /** Whether the last known place of a walk had no floor below. */
  readonly isHovering = signal(false);
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
    this.#scene = scene;
    this.#middle = centreOf(scene.core);
    this.#pivot = this.#middle;
    this.#diagonal = Math.hypot(...sizeOf(scene.core));
    this.#scale = scene.eyeHeight;
    this.#gaze = new Gaze(forward);
    this.#ground = new Ground(service, scene.tileSide);
    this.#walk = new Walk(this.eye, scene.eyeHeight);
    this.mode.value = scene.hasFloors ? "walk" : "fly";
    this.vfov.value = scene.vfovDeg;
    this.#lens = scene.vfovDeg;
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

  /** The eye and the viewing direction: see `Gaze`. The point `ahead` metres before the eye goes steadily. */
  get pose(): { eye: Point; heading: number; pitch: number; ahead: number } {
    const { heading, pitch } = this.#gaze;
    const ahead = this.#isParallel ? this.#projected.depthOf(this.#pivot ?? this.#ahead()) : 0;
    return { eye: this.eye, heading, pitch, ahead };
  }

  /** The point straight ahead that is as far away as the orbited one. */
  get focus(): Point {
    return beyond(this.eye, this.forward, this.#depth);
  }

  /** Metres from the eye to the orbited point; in walk mode there is none. */
  get reach(): number {
    const isWalk = this.mode.peek() === "walk";
    return isWalk ? Number.POSITIVE_INFINITY : distance(this.eye, this.#pivot ?? this.#middle);
  }

  /** Tangent of half the vertical field of view. */
  get tanHalfFov(): number {
    return tanOfHalf(this.vfovDeg);
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

  /** In parallel one orbits: another mode takes perspective. */
  setMode(mode: Mode): void {
    if (mode !== "orbit" && this.#isParallel) {
      this.toggleProjection();
    }
    this.mode.value = mode;
    this.#walk.place(this.eye);
  }

  /** Sets the field of view from where the eye is. */
  setVfov(degrees: number): void {
    this.isMoved = true;
    if (isParallel(degrees)) {
      this.vfov.value = PARALLEL_DEG;
      this.mode.value = "orbit";
      return;
    }
    this.#lens = Math.max(NARROWEST, Math.min(WIDEST, degrees));
    this.vfov.value = this.#lens;
  }

  /** Widens the field of view by so many degrees, or narrows it. A parallel picture shows more or less. */
  widen(degrees: number): void {
    if (this.#isParallel) {
      this.#approach(this.focus, -DOLLY * Math.sign(degrees));
    } else {
      this.setVfov(this.vfovDeg + degrees);
    }
  }

  /**
   * Goes over from perspective to parallel, or back, by a jump along the line of sight. The middle of the
   * picture keeps its size and its place.
   */
  toggleProjection(): void {
    this.history.leave(this.#cameraPose);
    const { eye, forward, tanHalfFov } = this;
    const pivot = this.#subject();
    const depth = this.#projected.depthOf(pivot);
    this.setVfov(this.#isParallel ? this.#lens : PARALLEL_DEG);
    this.goTo(beyond(eye, forward, depth * (1 - tanHalfFov / this.tanHalfFov)), forward);
    this.#pivot = pivot;
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
    const ahead = this.#slanting;
    this.frameFrom(box, mostOpen(sides, ahead) ?? ahead);
  }

  /**
   * Jumps to a place so far before a point, at the present side, and has it in the middle of the picture. In
   * parallel it is as large as from there.
   */
  lookAt(point: Point, away: number): void {
    this.history.leave(this.#cameraPose);
    const { forward } = new Gaze(this.#slanting);
    if (this.mode.peek() === "walk") {
      this.mode.value = "fly";
    }
    this.goTo(beyond(point, forward, -away * this.#longer), forward);
    this.#pivot = point;
  }

  /** The present heading, and a little downwards. */
  get #slanting(): Point {
    const { forward } = this;
    const level = Math.hypot(forward[0], forward[2]) || 1;
    return [(0.9 * forward[0]) / level, -0.44, (0.9 * forward[2]) / level];
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
      this.mode.value = "orbit";
    }
    const { width, height } = this.#size;
    const { tanHalfFov } = this;
    // The model does not reach into all corners of its box.
    const { core, outermost } = this.#scene;
    const points = box === core && outermost.length > 0 ? outermost : cornersOf(box);
    this.goTo(framingEye(points, gaze, (tanHalfFov * width) / height, tanHalfFov), gaze.forward);
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
    this.setVfov(vfovDeg);
    this.setMode(this.#isParallel ? "orbit" : mode);
    this.goTo(eye, forward);
  }

  #put({ eye, forward }: Sight): void {
    this.eye = eye;
    if (this.#isParallel) {
      this.#pivot = undefined;
    }
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
    if (this.#isParallel) {
      return this.#slide(seconds, motion);
    }
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
    this.isHovering.value = this.#walk.isHovering;
    return isMoved;
  }

  /** Moves the picture of a parallel view, and turns it up or down. */
  #slide(seconds: number, { ahead, right, up, turn, tilt }: Motion): boolean {
    const [x, y] = [right - turn, ahead + up];
    if (x === 0 && y === 0 && tilt === 0) {
      return false;
    }
    const way = PACE * this.#height * seconds * (this.#keys.isFast ? FASTER : 1);
    this.eye = pan(this.eye, this.#gaze, way * x, way * y);
    this.eye = turnAbout(this.#centre, this.eye, this.#gaze, 0, TURN * seconds * tilt);
    return true;
  }

  #glide(way: number, { ahead, right, up }: Motion): boolean {
    const [x, z] = this.#gaze.onGround(way * ahead, way * right);
    this.eye = [this.eye[0] + x, this.eye[1] + way * up, this.eye[2] + z];
    return ahead !== 0 || right !== 0 || up !== 0;
  }

  #drag({ right, down, isPan, pinch }: Drag, height: number): void {
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
      const each = this.#height / height;
      this.eye = pan(this.eye, this.#gaze, -right * each, down * each);
      if (pinch !== undefined) {
        this.#zoom(pinch.x, pinch.y, 1 - 1 / pinch.spread);
      }
    } else if (isOrbit) {
      this.eye = turnAbout(this.#centre, this.eye, this.#gaze, -ORBIT * right, -ORBIT * down);
    } else {
      this.#gaze.turn(MOUSE * right, MOUSE * down);
    }
  }

  /**
   * Begins to orbit the point there, or to approach the one between two fingers. On the background the old
   * pivot stays if it is visible.
   */
  #hold(x: number, y: number, fingers: 1 | 2): void {
    const held = this.pointAt(x, y, AROUND);
    this.#zoomed = fingers === 2 ? held : undefined;
    if (fingers === 2) {
      return;
    }
    if (held !== undefined || !this.#shows(this.#pivot)) {
      this.#pivot = held ?? this.#inMiddle() ?? this.#ahead();
    }
  }

  get #isParallel(): boolean {
    return this.projection.peek() === "parallel";
  }

  /** How many times as far away the eye is as with the lens of perspective. */
  get #longer(): number {
    return tanOfHalf(this.#lens) / this.tanHalfFov;
  }

  /** The smallest distance to an approached point. */
  get #closest(): number {
    return CLOSEST * this.#scale * this.#longer;
  }

  /** The orbited point. After a jump in parallel it is the one in the middle of the picture. */
  get #centre(): Point {
    this.#pivot ??= this.#inMiddle();
    return this.#pivot ?? this.#ahead();
  }

  /** Metres along the view to the orbited point. */
  get #depth(): number {
    return Math.max(this.#projected.depthOf(this.#centre), this.#closest);
  }

  /** Metres from the lower to the upper side of the picture, as far away as the orbited point. */
  get #height(): number {
    return 2 * this.#depth * this.tanHalfFov;
  }

  /** The point that keeps its size if the projection changes. */
  #subject(): Point {
    const pivot = this.mode.peek() === "orbit" && this.#shows(this.#pivot) ? this.#pivot : this.#inMiddle();
    return pivot ?? this.#ahead();
  }

  #shows(point: Point | undefined): boolean {
    return point !== undefined && this.#projected.shows(point);
  }

  /** The visible point in the middle of the picture. */
  #inMiddle(): Point | undefined {
    const { width, height } = this.#size;
    return this.pointAt(width / 2, height / 2, AROUND);
  }

  /** The middle of the model if it is visible, or else the point as far ahead. */
  #ahead(): Point {
    const middle = this.#middle;
    const way = distance(this.eye, middle);
    return this.#projected.shows(middle) ? middle : beyond(this.eye, this.forward, way);
  }

  /**
   * Approaches the visible point at a place of the canvas, or moves away from it. The point stays there. On
   * the background, the orbited point is approached; in parallel, the point there that is as far away.
   */
  #zoom(x: number, y: number, share: number): void {
    const projection = this.#projected;
    const zoomed = this.#zoomed && projection.place(this.#zoomed);
    if (zoomed === undefined || Math.hypot(zoomed.x - x, zoomed.y - y) > AROUND + 1) {
      this.#zoomed = this.pointAt(x, y, AROUND);
    }
    if (this.#isParallel) {
      this.#pivot = this.#zoomed ?? projection.point({ x, y, depth: this.#depth });
    } else {
      this.#pivot = this.#zoomed ?? (this.#shows(this.#pivot) ? this.#pivot : this.#ahead());
    }
    this.#approach(this.#centre, share);
  }

  /** Covers a share of the distance to a point. */
  #approach(to: Point, share: number): void {
    if (share >= 0 || !this.#isParallel || this.#height < HIGHEST * this.#diagonal) {
      this.eye = approach(to, this.eye, share, this.#closest);
      this.isMoved = true;
    }
  }

  /** The size of the canvas in CSS pixels. */
  get #size(): { width: number; height: number } {
    const { clientWidth, clientHeight } = this.#canvas;
    return { width: Math.max(1, clientWidth), height: Math.max(1, clientHeight) };
  }

  get #projected(): Projection {
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
      // On a German keyboard "?" is on a key of the field of view.
      const isShortcut = event.ctrlKey || event.metaKey || event.altKey || event.key === "?";
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
      (x, y, fingers) => this.#hold(x, y, fingers),
      (drag) => this.#drag(drag, canvas.clientHeight),
    );
    canvas.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        // With Shift, browsers turn the wheel to the side.
        const steps = -Math.sign(event.deltaY || event.deltaX);
        if (event.shiftKey || this.mode.peek() === "walk") {
          this.hasten(steps);
        } else {
          this.#zoom(event.offsetX, event.offsetY, DOLLY * steps);
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
