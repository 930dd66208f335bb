/** The page: a canvas that shows the scene from where a person walks. */

import { Display } from "./display/display.ts";
import { Renderer } from "./draw/renderer.ts";
import type { Camera } from "./proto/camera.ts";
import type { Settings } from "./proto/settings.ts";
import { type Point, Walker } from "./walk/walker.ts";

/** What the server says of the scene. Lengths in metres. */
interface SceneDescription {
  readonly name: string;
  readonly objects: number;
  readonly eyeHeight: number;
  readonly clearance: number;
  readonly vfovDeg: number;
  readonly start: { readonly eye: Point; readonly forward: Point };
}

/** The picture that is culled for is so much wider and higher: what a turn uncovers is there already. */
const WIDER = 1.25;
/** Milliseconds between cameras at least. */
const PERIOD = 30;
const EPSILON = 2;
const MEMORY = 512 << 20;

/** What a program that drives the page can see of it. */
export interface Seen {
  readonly walker: Walker;
  readonly renderer: Renderer;
  readonly display: Display | undefined;
  readonly pictures: number;
  /** The picture is exact, and of where the eye is now. */
  readonly isSettled: boolean;
  /** The camera of the picture. */
  readonly camera: Camera;
  /** The numbers of drawables at the pixels of the picture, rows from below. */
  items(): Uint32Array;
}

declare global {
  interface Window {
    trimaran?: Seen;
  }
}

class Page {
  readonly #canvas: HTMLCanvasElement;
  readonly #status: HTMLElement;
  readonly #scene: SceneDescription;
  readonly walker: Walker;
  readonly renderer: Renderer;
  display: Display | undefined;
  pictures = 0;
  #published = 0;
  #last = 0;
  #isMoved = true;
  #drawn: unknown;

  constructor(canvas: HTMLCanvasElement, status: HTMLElement, scene: SceneDescription) {
    [this.#canvas, this.#status, this.#scene] = [canvas, status, scene];
    this.walker = new Walker(scene.start.eye, scene.start.forward, (1.4 * scene.eyeHeight) / 1.7);
    this.renderer = new Renderer(canvas, {
      onRestored: () => {
        this.display?.loseGeometry();
        this.#isMoved = true;
      },
    });
    this.#resize();
    new ResizeObserver(() => this.#resize()).observe(canvas);
    this.#listen();
    void this.#join();
    requestAnimationFrame((now) => this.#picture(now));
  }

  get isSettled(): boolean {
    const { display } = this;
    return !this.#isMoved && display?.isSettled === true && this.#drawn === display.shown;
  }

  get camera(): Camera {
    return this.#camera(1);
  }

  items(): Uint32Array {
    return this.renderer.items(this.camera, this.display?.shown?.drawables ?? []);
  }

  /** The settings of a session: the picture that is culled for is wider than the one that is shown. */
  #settings(): Settings {
    return {
      viewport: this.#viewport(),
      levelRule: { epsilon: EPSILON, fewPixels: false },
      batch: 1024,
      coding: "changes",
      occlusionTest: "hzb",
    };
  }

  #viewport(): { width: number; height: number } {
    const { width, height } = this.#canvas;
    return { width: Math.ceil(WIDER * width), height: Math.ceil(WIDER * height) };
  }

  #camera(wider: number): Camera {
    const { eye, orientation } = this.walker;
    const tanHalfFov = Math.tan((this.#scene.vfovDeg * Math.PI) / 360) * wider;
    const near = this.#scene.clearance / 2;
    return { eye, orientation, tanHalfFov, near, frame: 0, viewState: 0 };
  }

  async #join(): Promise<void> {
    const url = new URL(`link${location.search}`, location.href);
    url.protocol = url.protocol === "https:" ? "wss:" : "ws:";
    for (let pause = 250; ; pause = Math.min(2 * pause, 5000)) {
      try {
        let ended: () => void = () => {};
        const over = new Promise<void>((resolve) => {
          ended = resolve;
        });
        this.display = await Display.join(
          url.href,
          { settings: this.#settings(), memory: MEMORY, store: this.renderer, onEnd: () => ended() },
          this.display,
        );
        this.#say("");
        this.#isMoved = true;
        await over;
        pause = 250;
      } catch (error) {
        this.#say(`The service does not answer: ${error instanceof Error ? error.message : error}`);
      }
      await new Promise((resolve) => setTimeout(resolve, pause));
    }
  }

  #picture(now: number): void {
    requestAnimationFrame((next) => this.#picture(next));
    const hasMoved = this.walker.step((now - this.#last) / 1000);
    this.#last = now;
    this.#isMoved ||= hasMoved;
    const { display } = this;
    if (display === undefined) {
      return;
    }
    if (this.#isMoved && !display.link.isOver && now - this.#published >= PERIOD) {
      // Its pixels are as large as those of the picture that is shown.
      display.publish(this.#camera(this.#viewport().height / this.#canvas.height));
      [this.#published, this.#isMoved] = [now, false];
      this.#drawn = undefined;
    }
    if (hasMoved || display.shown !== this.#drawn) {
      this.renderer.draw(this.#camera(1), display.shown?.drawables ?? []);
      this.#drawn = display.shown;
      this.pictures += 1;
    }
  }

  #resize(): void {
    const scale = window.devicePixelRatio;
    const width = Math.max(1, Math.round(this.#canvas.clientWidth * scale));
    const height = Math.max(1, Math.round(this.#canvas.clientHeight * scale));
    if (width === this.#canvas.width && height === this.#canvas.height) {
      return;
    }
    [this.#canvas.width, this.#canvas.height] = [width, height];
    this.display?.change({ pictureSize: this.#viewport() });
    this.#isMoved = true;
    this.#drawn = undefined;
  }

  #listen(): void {
    const canvas = this.#canvas;
    addEventListener("keydown", (event) => {
      if (!event.ctrlKey && !event.metaKey && this.walker.key(event.code, true)) {
        event.preventDefault();
      }
    });
    addEventListener("keyup", (event) => this.walker.key(event.code, false));
    // A link that is closed is no lost one.
    addEventListener("pagehide", () => this.display?.leave());
    addEventListener("blur", () => this.walker.release());
    canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      if (canvas.hasPointerCapture(event.pointerId)) {
        this.walker.look(-event.movementX, -event.movementY);
        this.#isMoved = true;
        this.#drawn = undefined;
      }
    });
    canvas.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        this.walker.hasten(-Math.sign(event.deltaY));
        this.#say(`${this.walker.speed.toPrecision(2)} m/s`);
      },
      { passive: false },
    );
  }

  #say(text: string): void {
    this.#status.textContent = text;
  }
}

async function begin(): Promise<void> {
  const canvas = document.querySelector<HTMLCanvasElement>("#picture");
  const status = document.querySelector<HTMLElement>("#status");
  if (canvas === null || status === null) {
    return;
  }
  try {
    const answer = await fetch(`scene${location.search}`);
    if (!answer.ok) {
      throw new Error(await answer.text());
    }
    const scene = (await answer.json()) as SceneDescription;
    document.title = `${scene.name} - Trimaran`;
    window.trimaran = new Page(canvas, status, scene);
  } catch (error) {
    status.textContent = error instanceof Error ? error.message : String(error);
  }
}

void begin();
