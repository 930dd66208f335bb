/** A canvas that shows the scene from a person's eye. */

import { computed, effect, type ReadonlySignal, signal } from "@preact/signals";
import type { Display, Shown } from "../display/display.ts";
import { ObjectColours } from "../draw/colours.ts";
import type { Drawable, Look } from "../draw/model.ts";
import { Projection } from "../draw/projection.ts";
import { type Picked, Renderer } from "../draw/renderer.ts";
import { orientationOf } from "../navigate/gaze.ts";
import { Navigator } from "../navigate/navigator.ts";
import type { Camera } from "../proto/camera.ts";
import { ObjectSet } from "../proto/objectSet.ts";
import type { OcclusionTest, Settings } from "../proto/settings.ts";
import type { ViewState } from "../proto/viewState.ts";
import type { SceneDescription, Service } from "../service/service.ts";
import { dot, type Point, pointOf } from "../space/point.ts";
import type { Size } from "../space/size.ts";
import { Hand } from "./hand.ts";
import { type Pose, Prediction } from "./prediction.ts";
import { sampling, widerBy, within } from "./sampling.ts";
import { Session } from "./session.ts";
import { type Distance, hasGhosts, ViewHistory } from "./viewHistory.ts";

/**
 * The eye is predicted for the time when its set arrives, and in turn for somewhat earlier and later: it may
 * slow down, or go around a corner.
 */
const SPREAD = [0.6, 1.2, 1.8];
/** The time for an eye that others follow: their eyes are where its sets were culled for, and go steadily. */
const STEADY = 1.2;
/** The least time between cameras, milliseconds. */
const PERIOD = 30;
/** How long after the last picture it is redrawn more finely, if none follows, milliseconds. */
const REST = 150;
/** Bytes of geometry on a machine of four GiB or more, or of unknown memory. */
const MEMORY = 512 << 20;

/** Where the page stores that it has restarted with another scene. */
const OTHER_SCENE = "trimaran.otherScene";

/** Whether the page has restarted with another scene. In a frame a browser may have no storage. */
export function hasRestarted(): boolean {
  try {
    const has = sessionStorage.getItem(OTHER_SCENE) !== null;
    sessionStorage.removeItem(OTHER_SCENE);
    return has;
  } catch {
    return false;
  }
}

/** How many cullers; `switch` are two in turn, each drawing the other one's visible set. */
export type Cullers = "1" | "2" | "3" | "4" | "switch";

/** A pixel that is this many heights of the picture behind its neighbours is seen through a gap. */
const GAP = 2;

/** An offered action. */
export interface Offer {
  readonly text: string;
  readonly label: string;
  readonly run: () => void;
}

/** Called with the camera and drawables of a picture. */
export type Overlay = (camera: Camera, drawables: readonly Drawable[]) => void;

/** The set of a followed display. */
type Led = Shown & { readonly led: ViewState };

export class Viewer {
  readonly canvas: HTMLCanvasElement;
  readonly scene: SceneDescription;
  readonly service: Service;
  readonly renderer: Renderer;
  readonly navigator: Navigator;
  readonly session: Session;
  readonly view: ViewHistory;
  readonly #modelSeeThrough: ObjectSet;
  /** The objects that a person has picked. */
  readonly selected = signal(ObjectSet.EMPTY);
  /** Clicks add one object to the selection, or remove it. */
  readonly picksMore = signal(false);
  /** The measured distances. */
  readonly distances = computed<readonly Distance[]>(() => this.view.current.value.distances);
  /** The colours over those of the model, if there are any. */
  readonly #colours: ReadonlySignal<ObjectColours | undefined>;
  /** The largest silhouette error in pixels, and the occlusion test of cullers. */
  readonly epsilon = signal(2);
  readonly occlusionTest = signal<OcclusionTest>("hzb");
  /** How many cullers, and how they share frames. */
  readonly cullers = signal<Cullers>("1");
  /** The size limit of unpacked geometry here, bytes. */
  readonly memory = signal(ownMemory());
  /** A message to the person about a recent event. */
  readonly said = signal("");
  /** An offered action, with its reason. */
  readonly offer = signal<Offer | undefined>(undefined);
  /** Where the pointer is on the canvas, in CSS pixels; nothing while it is elsewhere. */
  pointer: { readonly x: number; readonly y: number } | undefined;
  pictures = 0;
  readonly hand = new Hand();
  readonly #prediction = new Prediction();
  /** The next index into the spread. */
  #turn = 0;
  readonly #overlays = new Set<Overlay>();
  #published = 0;
  /** When the picture last changed. */
  #rested = 0;
  #last = 0;
  /** The newest pose was not published yet: a predicted one was, or none. */
  #isMoved = true;
  /** Whether culling pixels are wider than those of the picture. */
  #isCoarse = false;
  /** The set in the shown picture; nothing if it must be redrawn. */
  #drawn: unknown;
  /** The camera of the shown picture: the eye may have been moved since. */
  #pictured: Camera | undefined;
  /** Whether the picture is fitted to a leader's set. */
  #isFitted = false;
  /** The size of the picture that sets are culled for in place of the canvas, if there is one. */
  #other: Size | undefined;
  /** Whether others see what this eye sees. */
  isFollowed = false;

  /** `network` is the simulated one between the page and its culler; empty for none. */
  constructor(canvas: HTMLCanvasElement, scene: SceneDescription, service: Service, network: string) {
    [this.canvas, this.scene, this.service] = [canvas, scene, service];
    this.#modelSeeThrough = ObjectSet.coded(scene.seeThrough);
    this.view = new ViewHistory(this.#modelSeeThrough);
    const colouring = computed(() => this.view.current.value.colouring);
    this.#colours = computed(() => {
      return colouring.value.paints.length === 0 ? undefined : new ObjectColours(colouring.value);
    });
    this.renderer = new Renderer(canvas, {
      onRestored: () => {
        this.display?.loseGeometry();
        this.#isMoved = true;
      },
    });
    this.navigator = new Navigator(canvas, scene, service);
    this.navigator.pointAt = (x, y, around) => this.pointAt(x, y, around);
    this.#fit(undefined);
    const options = () => ({
      settings: this.#settings(),
      memory: this.memory.peek(),
      store: this.renderer,
      cullers: this.cullers.peek() === "switch" ? 2 : Number(this.cullers.peek()),
      schedule: this.cullers.peek() === "switch" ? ("switch" as const) : ("independent" as const),
      meeting: scene.meeting,
    });
    this.session = new Session(service, scene.fingerprint, options, network, beginAnew);
    // At each change, and for each new link.
    effect(() => {
      const occlusionTest = this.occlusionTest.value;
      this.display?.change({ ...this.view.seen.value, ...this.#sampling(), occlusionTest });
      this.#isMoved = true;
      this.redraw();
    });
    // Once, until there was a floor again.
    effect(() => {
      if (this.navigator.isHovering.value) {
        this.said.value = "No floor below: you hover. Fly (2) goes up and down.";
      }
    });
    effect(() => {
      const memory = this.memory.value;
      if (this.display !== undefined) {
        this.display.holdings.budget = memory;
      }
    });
    effect(() => {
      this.selected.value;
      this.#colours.value;
      this.redraw();
    });
    canvas.addEventListener("pointermove", ({ offsetX, offsetY }) => {
      this.pointer = { x: offsetX, y: offsetY };
    });
    canvas.addEventListener("pointerleave", () => {
      this.pointer = undefined;
    });
    new ResizeObserver(() => this.#resize()).observe(canvas);
    // Leaving the page is no lost link.
    addEventListener("pagehide", () => this.session.leave());
    requestAnimationFrame((now) => this.#picture(now));
  }

  get display(): Display | undefined {
    return this.session.display;
  }

  /** Whether the picture is exact, and from the present eye. */
  get isSettled(): boolean {
    return this.isExact && this.display?.isOver === false;
  }

  /** The same, also if the link has ended since. */
  get isExact(): boolean {
    const { display } = this;
    const isMoved = this.navigator.isMoved || (this.#isMoved && this.#led === undefined);
    return !isMoved && display?.isSettled === true && this.#drawn === display.shown;
  }

  /** The camera of the picture: of the present eye, or of the leader's set. */
  get camera(): Camera {
    const led = this.#led;
    if (led === undefined) {
      return this.#camera(1);
    }
    const { tanHalfFov } = within(this.canvas, this.navigator.tanHalfFov, led.camera, led.led.pictureSize);
    return { ...led.camera, tanHalfFov };
  }

  /** The largest silhouette error of an exact picture, pixels. */
  get errorPx(): number {
    return this.#led?.led.levelRule.epsilon ?? this.epsilon.peek();
  }

  /** The shown set, if it is that of a followed display. */
  get #led(): Led | undefined {
    const { leader, shown } = this.display ?? {};
    return leader !== undefined && shown?.led !== undefined ? { ...shown, led: shown.led } : undefined;
  }

  /** The age of the pose for which the drawn set was culled, milliseconds. */
  get setAge(): number {
    const { display } = this;
    return display?.shown === undefined ? 0 : performance.now() - display.shown.posed;
  }

  /** Pixels of the picture in a CSS pixel. */
  get scale(): number {
    return this.canvas.width / Math.max(1, this.canvas.clientWidth);
  }

  /** The numbers of drawables at the pixels of the picture, rows from below. */
  items(): Uint32Array {
    return this.renderer.items(this.camera, this.shown(), this.look());
  }

  /** The object at a place of the canvas, in CSS pixels from its upper left; nothing for background. */
  pick(x: number, y: number): Picked | undefined {
    return this.renderer.pick(x * this.scale, y * this.scale);
  }

  /**
   * The place of the canvas that a click there means, in CSS pixels: on the background, the nearest one with
   * an object within `reach`. Nothing if there is none.
   */
  meant(x: number, y: number, reach: number): { readonly x: number; readonly y: number } | undefined {
    if (this.pick(x, y) !== undefined) {
      return { x, y };
    }
    const { scale } = this;
    const met = this.renderer.nearby(x * scale, y * scale, Math.round(reach * scale));
    return met && { x: met.x / scale, y: met.y / scale };
  }

  /**
   * The visible point of the world at a place of the canvas. At the background or a gap it is searched for
   * within `around` CSS pixels; nothing if all of that is background.
   */
  pointAt(x: number, y: number, around = 0): Point | undefined {
    const picked = this.pick(x, y);
    const { scale } = this;
    const near = around > 0 && this.renderer.nearest(x * scale, y * scale, Math.round(around * scale));
    const { pictured } = this;
    if (near && (picked === undefined || picked.depth - near.depth > GAP * pictured.heightAt(near.depth))) {
      return pictured.point({ x: near.x / scale, y: near.y / scale, depth: near.depth });
    }
    return picked && pictured.point({ x, y, depth: picked.depth });
  }

  /** The projection of the present eye. */
  get projection(): Projection {
    return this.#through(this.camera);
  }

  /** The projection of the last picture, to which results of `pick` belong. */
  get pictured(): Projection {
    return this.#through(this.#pictured ?? this.camera);
  }

  /** Continues with other cullers. */
  share(cullers: Cullers): void {
    this.cullers.value = cullers;
    this.session.moveTo(this.session.network.peek());
  }

  /** Redraws the picture, though neither eye nor set has changed. */
  redraw(): void {
    this.#drawn = undefined;
  }

  /**
   * Requests the visible set of `camera`, even if the eye has left it. Returns the frame's number; nothing
   * without a link, or while another picture is culled for.
   */
  ask(camera: Camera): number | undefined {
    const { display } = this;
    if (display === undefined || display.isOver || this.#other !== undefined) {
      return undefined;
    }
    // No newer camera replaces it before the culler is free for it.
    this.#published = performance.now() + display.interval;
    this.#isMoved = true;
    this.#coarsen(false);
    const tanHalfFov = camera.tanHalfFov * widerBy(this.canvas);
    return display.publish({ ...camera, tanHalfFov }, true);
  }

  /**
   * Culls for a picture of this size from this camera, and for nothing else until `endOther`. The set is
   * there once the display is settled. Returns whether there is a link.
   */
  beginOther(camera: Camera, size: Size): boolean {
    const { display } = this;
    if (display === undefined || display.isOver) {
      return false;
    }
    this.#other = size;
    display.change(this.#sampling());
    display.publish(camera, false);
    return true;
  }

  /** Culls for the canvas again. */
  endOther(): void {
    this.#other = undefined;
    this.display?.change(this.#sampling());
    this.#isMoved = true;
    this.redraw();
  }

  /** Draws at once, and finely. The canvas can be read until this task ends. */
  drawNow(): void {
    this.#pictured = this.camera;
    this.renderer.draw(this.#pictured, this.shown(), this.look());
    while (this.renderer.refine()) {}
  }

  /** Calls `overlay` after each picture, until the returned function is called. */
  onPicture(overlay: Overlay): () => void {
    this.#overlays.add(overlay);
    this.redraw();
    return () => this.#overlays.delete(overlay);
  }

  /** The drawables to draw: the set may have been found before something was hidden. */
  shown(): readonly Drawable[] {
    const { hidden, isolated } = this.view.current.peek();
    const shown = this.display?.shown?.drawables ?? [];
    if (this.display?.shown?.led !== undefined) {
      return shown;
    }
    if (hidden.isEmpty && isolated === undefined) {
      return shown;
    }
    return shown.filter(
      ({ object, objects }) => objects > 1 || !(hidden.has(object) || isolated?.has(object) === false),
    );
  }

  /** How the picture differs from the plain model. */
  look(): Look {
    const led = this.display?.shown?.led;
    const own = this.view.current.peek();
    const sections = led?.sections ?? own.sections;
    const seeThrough = led ? (led.seeThrough ?? this.#modelSeeThrough) : own.seeThrough;
    const areGhosts = hasGhosts({ seeThrough }, this.scene.objects, this.#modelSeeThrough);
    const [highlighted, colours] = [this.selected.peek(), this.#colours.peek()];
    return { sections, seeThrough, areGhosts, highlighted, colours };
  }

  /** The settings of a session. */
  #settings(): Settings {
    const { pictureSize, levelRule } = sampling(this.canvas, this.epsilon.peek(), false, this.#most);
    return {
      viewport: pictureSize,
      levelRule,
      batch: 1024,
      coding: "changes",
      occlusionTest: this.occlusionTest.peek(),
    };
  }

  /** The largest picture that the service culls for. */
  get #most(): Size {
    const [width, height] = this.scene.maxPicture;
    return { width, height };
  }

  /** The resolution of culling. */
  #sampling(): Pick<ViewState, "pictureSize" | "levelRule"> {
    if (this.#other !== undefined) {
      const { width, height } = this.#other;
      const levelRule = { epsilon: this.epsilon.value, fewPixels: false };
      return { pictureSize: { width, height }, levelRule };
    }
    return sampling(this.canvas, this.epsilon.value, this.#isCoarse, this.#most);
  }

  #through(camera: Camera): Projection {
    const { clientWidth, clientHeight } = this.canvas;
    return new Projection(camera, clientWidth, clientHeight);
  }

  #camera(wider: number): Camera {
    const { eye, orientation } = this.navigator;
    const tanHalfFov = this.navigator.tanHalfFov * wider;
    return { eye, orientation, tanHalfFov, near: this.#near, frame: 0, viewState: 0 };
  }

  get #near(): number {
    const { scene, navigator } = this;
    const { clearance } = scene;
    // Nothing is nearer to a walking eye. In other modes the eye may approach a bolt.
    const near = Math.min(clearance / 2, Math.max(clearance / 200, navigator.reach / 8));
    if (navigator.projection.peek() === "perspective") {
      return near;
    }
    // Depth of some devices is coarse far beyond the near plane. The eye is far before the whole model.
    const { eye, forward } = navigator;
    const front = pointOf((axis) => scene[forward[axis] > 0 ? "min" : "max"][axis] - eye[axis]);
    return Math.max(near, dot(front, forward) / 2);
  }

  #picture(now: number): void {
    requestAnimationFrame((next) => this.#picture(next));
    const interval = now - this.#last;
    // A walker asks for the ground, which would compete with the first picture for the service.
    const hasMoved = this.pictures > 0 && this.navigator.step(interval / 1000);
    this.#last = now;
    this.#isMoved ||= hasMoved;
    const { display } = this;
    if (display === undefined) {
      return;
    }
    if (this.navigator.hasJumped()) {
      this.#prediction.forget();
    }
    this.#prediction.add(now, this.navigator.pose);
    const isLed = this.#led !== undefined;
    if (isLed || this.#isFitted) {
      this.#isFitted = isLed;
      this.#resize();
    }
    const isOwn = display.leader === undefined && this.#other === undefined;
    if (this.#isMoved && isOwn && !display.isOver && now - this.#published >= PERIOD) {
      // The set arrives when the eye has reached the predicted pose. Once it rests, its own pose follows.
      const foreseen = hasMoved ? this.#foreseen(display.latency + PERIOD / 2) : undefined;
      this.#coarsen(foreseen !== undefined);
      const camera = this.#camera(widerBy(this.canvas));
      const pose = foreseen && {
        eye: foreseen.eye,
        orientation: orientationOf(foreseen.heading, foreseen.pitch),
      };
      display.publish({ ...camera, ...pose }, foreseen !== undefined);
      [this.#published, this.#isMoved] = [now, foreseen !== undefined];
      this.#drawn = undefined;
    }
    if (hasMoved) {
      this.renderer.motion.add(interval);
    } else {
      this.renderer.motion.rest();
    }
    if (hasMoved || display.shown !== this.#drawn) {
      const [camera, drawables] = [this.camera, this.shown()];
      this.renderer.draw(camera, drawables, this.look());
      this.#pictured = camera;
      this.#drawn = display.shown;
      this.pictures += 1;
      this.#rested = now;
      for (const overlay of this.#overlays) {
        overlay(camera, drawables);
      }
    } else if (now - this.#rested > REST) {
      this.renderer.refine(true);
    }
    this.hand.follow(hasMoved);
  }

  /** Sets whether the next camera is culled for with wider pixels. */
  #coarsen(isCoarse: boolean): void {
    if (isCoarse !== this.#isCoarse) {
      this.#isCoarse = isCoarse;
      this.display?.change(this.#sampling());
    }
  }

  #foreseen(ahead: number): Pose | undefined {
    this.#turn = (this.#turn + 1) % SPREAD.length;
    return this.#prediction.after(ahead * (this.isFollowed ? STEADY : (SPREAD[this.#turn] ?? 1)));
  }

  #resize(): void {
    if (this.#fit(this.#led)) {
      this.display?.change(this.#sampling());
      this.#isMoved = true;
      this.#drawn = undefined;
    }
  }

  /** Fits the picture to its place on the screen. Returns whether its size changed. */
  #fit(led: Led | undefined): boolean {
    const { canvas } = this;
    const scale = window.devicePixelRatio;
    const own = {
      width: Math.max(1, Math.round(canvas.clientWidth * scale)),
      height: Math.max(1, Math.round(canvas.clientHeight * scale)),
    };
    const { width, height } = led
      ? within(own, this.navigator.tanHalfFov, led.camera, led.led.pictureSize)
      : own;
    const isOther = width !== canvas.width || height !== canvas.height;
    if (isOther) {
      [canvas.width, canvas.height] = [width, height];
    }
    return isOther;
  }
}

/** The service has another model now: reloads the page, discarding the state of the old one. */
function beginAnew(): void {
  try {
    sessionStorage.setItem(OTHER_SCENE, "yes");
  } catch {
    // The person is not told then.
  }
  if (location.hash.startsWith("#v=")) {
    history.replaceState(null, "", location.pathname + location.search);
  }
  location.reload();
}

/** An eighth of the machine's memory: a phone has little. */
function ownMemory(): number {
  const { deviceMemory: gibibytes = 4 } = navigator as { readonly deviceMemory?: number };
  return Math.min(MEMORY, (gibibytes * 2 ** 30) / 8);
}
