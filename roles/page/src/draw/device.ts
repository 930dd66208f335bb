/** All resources of a WebGL2 context. They are lost with the context, and made anew for the next one. */

import type { ObjectSet } from "../proto/objectSet.ts";
import { pointOf } from "../space/point.ts";
import { GeometryArena } from "./arena.ts";
import { clearToBackground } from "./background.ts";
import { Batch } from "./batch.ts";
import { cutPlanes } from "./cut.ts";
import { type Features, featuresOf } from "./features.ts";
import type { Camera, Drawable, Look } from "./model.ts";
import { Program } from "./program.ts";
import { fitting, type Region, whole } from "./region.ts";
import { itemFragment, itemVertex, pictureFragment, pictureVertex } from "./shaders.ts";
import type { Smoother } from "./smoother.ts";
import { isSmootherDue, smootherClass } from "./smoothing.ts";
import { IN_MOTION, STEPS, type Step, Still, stepOf } from "./still.ts";
import { CanvasTarget, type PictureTarget, Target } from "./target.ts";
import { at, View } from "./view.ts";

/** The opacity of see-through objects. */
const SEE_THROUGH = 0.25;
/** The same of ghosts. */
const GHOST = 0.08;
/** Milliseconds between two looks at whether something is drawn. */
const LOOK = 5;
/** No drawable has this number. */
export const NOTHING = 0xffff_ffff;
const NO_ITEM = [NOTHING, 0, 0, 0];

export interface DeviceOptions {
  readonly samples: number | undefined;
  readonly extensions: boolean | undefined;
  /** Whether pictures are drawn onto the canvas itself: see `canvasDepth.ts`. */
  readonly isOnCanvas: boolean;
}

export class Device {
  readonly features: Features;
  readonly arena: GeometryArena;
  /** For pictures, and for ID buffers: they allocate separately. */
  readonly batch: Batch;
  readonly samples: number;
  readonly #gl: WebGL2RenderingContext;
  readonly #itemBatch: Batch;
  readonly #view = new View();
  readonly #pictureTarget: PictureTarget;
  #itemTarget: Target | undefined;
  #aroundTarget: Target | undefined;
  #seeThroughBatch: Batch | undefined;
  readonly #programs = new Map<string, Program>();
  #smoother: Smoother | undefined;
  #still: Still | undefined;
  /** The region that is drawn in place of the whole picture of the canvas. */
  #region: Region | undefined;
  /** The shift of the picture in pixels. */
  #shift: readonly [number, number] = [0, 0];
  /** Of the last step of a picture. */
  #fence: WebGLSync | null = null;

  constructor(gl: WebGL2RenderingContext, options: DeviceOptions) {
    this.#gl = gl;
    this.features = featuresOf(gl, options.extensions);
    const { provoking, isSoftware, mostSamples } = this.features;
    this.samples = Math.min(options.samples ?? (isSoftware ? 1 : 4), mostSamples);
    this.#pictureTarget = options.isOnCanvas ? new CanvasTarget(gl) : new Target(gl, gl.RGBA8, this.samples);
    this.arena = new GeometryArena(gl, provoking);
    this.batch = new Batch(gl, this.features);
    this.#itemBatch = new Batch(gl, this.features);
  }

  /** Draws onto the canvas; with lines and dark corners, if it is to have them. */
  draw(camera: Camera, drawables: readonly Drawable[], look: Look, haveLines = false): void {
    if (haveLines) {
      this.refine(camera, drawables, look, IN_MOTION);
      return;
    }
    this.#drawPicture(this.#pictureTarget, camera, drawables, look);
    this.#pictureTarget.show();
  }

  /**
   * Makes normals for the round surfaces of drawables, for so many milliseconds. Returns whether all that can
   * have theirs do.
   */
  smooth(drawables: readonly Drawable[], milliseconds = Number.POSITIVE_INFINITY): boolean {
    const Made = smootherClass();
    this.#smoother ??= Made && new Made(this.#gl, this.arena);
    return this.#smoother?.smooth(drawables, milliseconds) ?? !isSmootherDue();
  }

  /** Whether the device still draws the last step of a picture. */
  get isRefining(): boolean {
    return this.#fence !== null && isPending(this.#gl, this.#fence);
  }

  /** Draws a step of a picture, and shows the mean of the steps so far. */
  refine(camera: Camera, drawables: readonly Drawable[], look: Look, step: Step): void {
    this.#still ??= new Still(this.#gl);
    this.#drawStep(this.#pictureTarget, this.#still, camera, drawables, look, step);
    this.#still.show();
    this.#gl.deleteSync(this.#fence);
    this.#fence = this.#gl.fenceSync(this.#gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
  }

  /**
   * The pixels of a region of a picture, as fine as those of an eye at rest: red, green, blue and alpha, rows
   * from below. The canvas stays as it is.
   */
  async drawRegion(
    camera: Camera,
    drawables: readonly Drawable[],
    look: Look,
    region: Region,
  ): Promise<Uint8Array> {
    const gl = this.#gl;
    const target = new Target(gl, gl.RGBA8, this.samples);
    const still = new Still(gl);
    this.smooth(drawables);
    this.#region = region;
    try {
      for (let step = 0; step < STEPS; step += 1) {
        this.#drawStep(target, still, camera, drawables, look, stepOf(step, false));
      }
    } finally {
      this.#region = undefined;
    }
    try {
      await drawn(gl);
      return still.read();
    } finally {
      target.delete();
      still.delete();
    }
  }

  #drawStep(
    target: PictureTarget,
    still: Still,
    camera: Camera,
    drawables: readonly Drawable[],
    look: Look,
    step: Step,
  ): void {
    const region = this.#drawn;
    this.#shift = step.shift;
    this.#drawPicture(target, camera, drawables, look, step.isSoft);
    still.takePicture(region.width, region.height);
    const { opaque, seeThrough } = apart(drawables, look.seeThrough);
    still.beginObjects("opaque");
    this.#drawItems(camera, opaque, look, "object");
    const haveLines = seeThrough.length > 0 && look.areGhosts !== true;
    if (haveLines) {
      // See-through objects have lines of their own, and those of the opaque ones stay.
      still.beginObjects("all");
      this.#drawItems(camera, drawables, look, "object");
    }
    const { tanX, tanY } = this.#view;
    still.add(step, region, [tanX, tanY], haveLines);
    this.#shift = [0, 0];
  }

  /** The region that is drawn. */
  get #drawn(): Region {
    return this.#region ?? whole(this.#gl.canvas);
  }

  /** `isSoft`: round surfaces look so. They all have their normals. */
  #drawPicture(
    target: PictureTarget,
    camera: Camera,
    drawables: readonly Drawable[],
    look: Look,
    isSoft = false,
  ): void {
    const { opaque, seeThrough } = apart(drawables, look.seeThrough);
    const region = this.#drawn;
    target.begin(region.width, region.height);
    this.#setView(camera);
    clearToBackground(this.#gl, this.#view, region);
    const picture = this.#program(isSoft ? "soft picture" : "picture", look);
    picture.use();
    this.#setUp(picture);
    this.#prepare(picture, camera, look);
    this.batch.draw(this.#view, opaque, this.arena, picture, look);
    if (seeThrough.length > 0) {
      this.#drawSeeThrough(picture, seeThrough, look);
    }
  }

  #setView(camera: Camera): void {
    const { of } = this.#drawn;
    this.#view.set(camera, of.width, of.height);
    if (this.#region !== undefined) {
      this.#view.narrow(this.#region);
    }
  }

  /** The number of the drawable at each pixel, rows from below. */
  items(camera: Camera, drawables: readonly Drawable[], look: Look): Uint32Array {
    const gl = this.#gl;
    const { width, height } = gl.canvas;
    this.#itemTarget ??= new Target(gl, gl.R32UI);
    this.#itemTarget.begin(width, height);
    this.#drawItems(camera, drawables, look);
    const numbers = new Uint32Array(width * height);
    this.#itemTarget.read(gl.RED_INTEGER, numbers);
    return numbers;
  }

  /**
   * The drawables at the pixels around one that is counted from the upper left, and their distances along the
   * view: a square with `radius` on each side of it, rows from below.
   */
  around(
    camera: Camera,
    drawables: readonly Drawable[],
    look: Look,
    [x, y]: readonly [number, number],
    radius: number,
  ): readonly { readonly item: number; readonly depth: number }[] {
    const gl = this.#gl;
    const { width, height } = gl.canvas;
    const side = 2 * radius + 1;
    this.#aroundTarget ??= new Target(gl, gl.RG32UI);
    this.#aroundTarget.begin(side, side);
    // Moves the picture so that only these pixels are drawn.
    gl.viewport(radius - x, radius + y + 1 - height, width, height);
    this.#drawItems(camera, drawables, look);
    const numbers = new Uint32Array(4 * side * side);
    this.#aroundTarget.read(gl.RGBA_INTEGER, numbers);
    const depths = new Float32Array(numbers.buffer);
    return Array.from({ length: side * side }, (_, pixel) => {
      return { item: at(numbers, 4 * pixel), depth: at(depths, 4 * pixel + 1) };
    });
  }

  #drawItems(
    camera: Camera,
    drawables: readonly Drawable[],
    look: Look,
    of: "item" | "object" = "item",
  ): void {
    const gl = this.#gl;
    gl.clearBufferuiv(gl.COLOR, 0, NO_ITEM);
    this.#setView(camera);
    const program = this.#program(of, look);
    program.use();
    this.#prepare(program, camera, look);
    this.#itemBatch.draw(this.#view, drawables, this.arena, program, look);
  }

  /** Drawn over the opaque ones. They do not hide each other. */
  #drawSeeThrough(picture: Program, drawables: readonly Drawable[], look: Look): void {
    const gl = this.#gl;
    picture.use();
    gl.depthFunc(this.features.depth === "reversed" ? gl.GREATER : gl.LESS);
    gl.depthMask(false);
    gl.enable(gl.BLEND);
    gl.blendColor(0, 0, 0, look.areGhosts === true ? GHOST : SEE_THROUGH);
    gl.blendFunc(gl.CONSTANT_ALPHA, gl.ONE_MINUS_CONSTANT_ALPHA);
    this.#seeThroughBatch ??= new Batch(gl, this.features);
    this.#seeThroughBatch.draw(this.#view, drawables, this.arena, picture, look);
    gl.disable(gl.BLEND);
    gl.depthMask(true);
  }

  /** A program of this kind, with clipping if there are sections. It is made on first use. */
  #program(what: "picture" | "soft picture" | "item" | "object", { sections }: Look): Program {
    const isCut = sections.length > 0;
    const key = `${what}${isCut ? " cut" : ""}`;
    let program = this.#programs.get(key);
    if (program === undefined) {
      const { depth, multiDraw } = this.features;
      const number = multiDraw === null ? "uniform" : "multi-draw";
      const isSoft = what === "soft picture";
      program =
        what === "picture" || isSoft
          ? new Program(this.#gl, pictureVertex(number, depth, isCut, isSoft), pictureFragment(isCut, isSoft))
          : new Program(
              this.#gl,
              itemVertex(number, depth, isCut, what === "item" ? "drawable" : "object"),
              itemFragment(isCut),
            );
      this.#programs.set(key, program);
    }
    return program;
  }

  #prepare(program: Program, camera: Camera, { sections }: Look): void {
    const gl = this.#gl;
    if (sections.length > 0) {
      const planes = cutPlanes(sections, this.#view, camera);
      gl.uniform4fv(program.at("planes"), planes);
      gl.uniform1i(program.at("planeCount"), planes.length / 4);
    }
    const isReversed = this.features.depth === "reversed";
    gl.enable(gl.DEPTH_TEST);
    // Of equal depths the first drawn stays.
    gl.depthFunc(isReversed ? gl.GREATER : gl.LESS);
    gl.clearDepth(isReversed ? 0 : 1);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    const { scale, shift } = fitting(this.#drawn, this.#shift);
    gl.uniform2f(program.at("scale"), scale[0] / this.#view.tanX, scale[1] / this.#view.tanY);
    gl.uniform1f(program.at("near"), this.#view.near);
    gl.uniform2f(program.at("shift"), ...shift);
  }

  /** Sets the upward direction. */
  #setUp(program: Program): void {
    const [x, y, z] = pointOf((axis) => this.#view.along(axis, 0, 1, 0));
    this.#gl.uniform3f(program.at("up"), x, y, z);
  }
}

/** Separates drawables of see-through objects from all others. */
function apart(
  drawables: readonly Drawable[],
  objects: ObjectSet,
): { readonly opaque: readonly Drawable[]; readonly seeThrough: readonly Drawable[] } {
  if (objects.isEmpty) {
    return { opaque: drawables, seeThrough: [] };
  }
  const isThrough = ({ object }: Drawable) => objects.has(object);
  return {
    opaque: drawables.filter((drawable) => !isThrough(drawable)),
    seeThrough: drawables.filter(isThrough),
  };
}

/** Waits until all that was asked of the device is drawn, or the context is lost. The page goes on. */
async function drawn(gl: WebGL2RenderingContext): Promise<void> {
  const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
  if (fence === null) {
    return;
  }
  while (isPending(gl, fence)) {
    await new Promise((resolve) => setTimeout(resolve, LOOK));
  }
  gl.deleteSync(fence);
}

/** Whether something that was asked of the device before this fence is not drawn yet. */
function isPending(gl: WebGL2RenderingContext, fence: WebGLSync): boolean {
  const state = gl.clientWaitSync(fence, gl.SYNC_FLUSH_COMMANDS_BIT, 0);
  return state === gl.TIMEOUT_EXPIRED && !gl.isContextLost();
}
