/** Draws drawables out of pieces of geometry that come and go. */

import type { Drawn } from "./batch.ts";
import { canDrawOnCanvas } from "./canvasDepth.ts";
import { Device, NOTHING } from "./device.ts";
import type { Depth, DrawNumber } from "./features.ts";
import { leastOf, type Met, metIn } from "./met.ts";
import { type Camera, type Drawable, type Look, type Mesh, PLAIN, type Triangles } from "./model.ts";
import { MotionLook } from "./motionLook.ts";
import type { Region } from "./region.ts";
import { isSmootherDue, loadSmoother } from "./smoothing.ts";
import { STEPS, stepOf } from "./still.ts";

export { NOTHING } from "./device.ts";

export interface RendererOptions {
  /** Samples a pixel; 1 draws without antialiasing. By default 4 on a graphics card, and 1 without one. */
  readonly samples?: number;
  /** Whether to use extensions of WebGL2 that the browser has; by default those that make it faster. */
  readonly extensions?: boolean;
  /** The device has lost everything. Nothing is drawn until `onRestored`. */
  readonly onLost?: () => void;
  /** Drawing goes on, but every piece is gone: the caller sets them again. */
  readonly onRestored?: () => void;
}

/** The cost of the last picture. */
export interface PictureStats extends Readonly<Drawn> {
  /** Milliseconds of this thread. The device may take longer. */
  readonly milliseconds: number;
}

/** The object at a pixel. */
export interface Picked {
  readonly drawable: number;
  /** Nothing if the drawable shows several. */
  readonly object: number | undefined;
  /** All objects of the drawable: from `first` to before `end`. */
  readonly first: number;
  readonly end: number;
  /** Metres from the eye, along the viewing direction. */
  readonly depth: number;
}

/** A drawn picture. */
interface Picture {
  readonly camera: Camera;
  readonly drawables: readonly Drawable[];
  readonly look: Look;
}

/** How long normals of round surfaces are made between two pictures of the screen, milliseconds. */
const SMOOTHING = 12;

export class Renderer {
  readonly #canvas: HTMLCanvasElement;
  readonly #gl: WebGL2RenderingContext;
  readonly #options: RendererOptions;
  readonly #isOnCanvas: boolean;
  /** Nothing while the context is lost. */
  #device: Device | undefined;
  readonly #stats = { calls: 0, drawables: 0, triangles: 0, milliseconds: 0 };
  #last: Picture | undefined;
  /** Refinement steps in the shown picture, and whether it had lines before the first. */
  #steps = 0;
  #haveLines = false;
  /** Of pictures of a moving eye. */
  readonly motion: MotionLook;
  readonly depth: Depth;
  readonly drawNumber: DrawNumber;
  /** The device's name, by its driver. */
  readonly device: string;
  readonly samples: number;

  /** Throws if the browser has no WebGL2. */
  constructor(canvas: HTMLCanvasElement, options: RendererOptions = {}) {
    this.#isOnCanvas = canDrawOnCanvas(options.samples, options.extensions);
    const gl = canvas.getContext("webgl2", {
      antialias: false,
      depth: this.#isOnCanvas,
      powerPreference: "high-performance",
    });
    if (gl === null) {
      throw new Error("this browser has no WebGL2, which drawing needs");
    }
    [this.#canvas, this.#gl, this.#options] = [canvas, gl, options];
    const device = this.#make();
    this.#device = device;
    this.depth = device.features.depth;
    this.drawNumber = device.features.multiDraw === null ? "uniform" : "multi-draw";
    this.device = device.features.device;
    this.samples = device.samples;
    this.motion = new MotionLook(!device.features.isSoftware);
    canvas.addEventListener("webglcontextlost", (event) => {
      // Without this the browser does not restore it.
      event.preventDefault();
      this.#device = undefined;
      options.onLost?.();
    });
    canvas.addEventListener("webglcontextrestored", () => {
      this.#device = this.#make();
      options.onRestored?.();
    });
  }

  /** Bytes of geometry on the device. */
  get bytes(): number {
    return this.#device?.arena.bytes ?? 0;
  }

  /** Bytes on the device for geometry, used or free. */
  get capacity(): number {
    return this.#device?.arena.capacity ?? 0;
  }

  get isLost(): boolean {
    return this.#device === undefined;
  }

  /** The cost of the last picture. */
  get drawn(): PictureStats {
    return this.#stats;
  }

  /** Whether the canvas shows the last picture fully refined: smooth, and with lines. */
  get isFine(): boolean {
    return this.#steps === STEPS;
  }

  /** Takes a piece of geometry, replacing the one of that number. A lost context ignores it. */
  setPiece(number: number, piece: Mesh): void {
    this.#device?.arena.set(number, piece);
  }

  dropPiece(number: number): void {
    this.#device?.arena.drop(number);
  }

  /** Draws those `drawables` whose geometry is here, onto the canvas. */
  draw(camera: Camera, drawables: readonly Drawable[], look: Look = PLAIN): void {
    const begun = performance.now();
    this.#last = { camera, drawables, look };
    [this.#steps, this.#haveLines] = [0, this.motion.isOn];
    this.#device?.draw(camera, drawables, look, this.#haveLines);
    Object.assign(this.#stats, this.#device?.batch.drawn);
    this.#stats.milliseconds = performance.now() - begun;
    void loadSmoother();
  }

  /**
   * Draws the last picture one step finer, once its round surfaces have normals. Returns whether there is
   * more to do. If it `waits`, nothing is done until the code for normals is there, and while the device
   * still draws the step before: so a pick or a picture waits for one step at most. Else surfaces are flat
   * until then.
   */
  refine(waits = false): boolean {
    if (this.#device !== undefined && this.#last !== undefined && this.#steps < STEPS) {
      const { camera, drawables, look } = this.#last;
      if (waits && this.#device.isRefining) {
        return true;
      }
      if (!this.#device.smooth(drawables, SMOOTHING) && (waits || !isSmootherDue())) {
        return true;
      }
      this.#device.refine(camera, drawables, look, stepOf(this.#steps, this.#haveLines));
      this.#steps += 1;
    }
    return this.#steps < STEPS;
  }

  /** Makes normals for the round surfaces of drawables, for a moment. Returns whether all have theirs. */
  smooth(drawables: readonly Drawable[]): boolean {
    return this.#device?.smooth(drawables, SMOOTHING) ?? true;
  }

  /**
   * The pixels of a region of a larger picture, as fine as those of an eye at rest: red, green, blue and
   * alpha, rows from below. Nothing if the context is lost. The canvas stays as it is.
   */
  async drawRegion(
    camera: Camera,
    drawables: readonly Drawable[],
    look: Look,
    region: Region,
  ): Promise<Uint8Array | undefined> {
    const device = this.#device;
    const pixels = await device?.drawRegion(camera, drawables, look, region);
    // It may have been lost and given back meanwhile.
    return this.#gl.isContextLost() || device !== this.#device ? undefined : pixels;
  }

  /** The object at a pixel of the last picture, counted from the upper left; nothing for background. */
  pick(x: number, y: number): Picked | undefined {
    const { width, height } = this.#canvas;
    const [column, row] = [Math.floor(x), Math.floor(y)];
    const isInside = column >= 0 && row >= 0 && column < width && row < height;
    if (this.#device === undefined || this.#last === undefined || !isInside) {
      return undefined;
    }
    const { camera, look } = this.#last;
    for (const candidates of candidatesOf(this.#last)) {
      const [met] = this.#device.around(camera, candidates, look, [column, row], 0);
      const drawable = candidates.find(({ id }) => id === met?.item);
      if (met !== undefined && drawable !== undefined) {
        const { id, object: first, objects } = drawable;
        const object = objects === 1 ? first : undefined;
        return { drawable: id, object, first, end: first + objects, depth: met.depth };
      }
    }
    return undefined;
  }

  /**
   * The pixel nearest to the eye within a radius of one that is counted from the upper left; nothing if all
   * is background. See-through objects are ignored.
   */
  nearest(x: number, y: number, radius: number): Met | undefined {
    const [opaque = []] = candidatesOf(this.#last);
    return leastOf(this.#metAround(x, y, radius, opaque), ({ depth }) => depth);
  }

  /**
   * The covered pixel nearest in the picture to one that is counted from the upper left, within a radius;
   * nothing if all is background. See-through objects count only if nothing else is there.
   */
  nearby(x: number, y: number, radius: number): Met | undefined {
    const middle = { x: Math.floor(x) + 0.5, y: Math.floor(y) + 0.5 };
    const away = (met: Met) => Math.hypot(met.x - middle.x, met.y - middle.y);
    for (const candidates of candidatesOf(this.#last)) {
      const met = leastOf(this.#metAround(x, y, radius, candidates), away);
      if (met !== undefined) {
        return met;
      }
    }
    return undefined;
  }

  /** The covered pixels within a radius of one that is counted from the upper left. */
  #metAround(x: number, y: number, radius: number, drawables: readonly Drawable[]): readonly Met[] {
    if (this.#device === undefined || this.#last === undefined) {
      return [];
    }
    const { camera, look } = this.#last;
    const [column, row] = [Math.floor(x), Math.floor(y)];
    return metIn(this.#device.around(camera, drawables, look, [column, row], radius), column, row, radius);
  }

  /** The triangles of a piece of geometry in its local frame: positions, and three indices each. */
  triangles(number: number): Triangles | undefined {
    return this.#device?.arena.triangles(number);
  }

  /** The number of the drawable at each pixel, rows from below; `NOTHING` for the background. */
  items(camera: Camera, drawables: readonly Drawable[], look: Look = PLAIN): Uint32Array {
    const { width, height } = this.#canvas;
    return this.#device?.items(camera, drawables, look) ?? new Uint32Array(width * height).fill(NOTHING);
  }

  #make(): Device {
    const { samples, extensions } = this.#options;
    return new Device(this.#gl, { samples, extensions, isOnCanvas: this.#isOnCanvas });
  }
}

/** Those to look for a pick in, in turn: see-through objects count only if nothing else is met. */
function candidatesOf(picture: Picture | undefined): readonly (readonly Drawable[])[] {
  if (picture === undefined) {
    return [];
  }
  const { drawables, look } = picture;
  const { seeThrough } = look;
  return seeThrough.isEmpty
    ? [drawables]
    : [drawables.filter(({ object }) => !seeThrough.has(object)), drawables];
}
