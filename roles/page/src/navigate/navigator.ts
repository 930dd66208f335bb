/** Where a person is in the scene, and what moves them there. */

import { signal } from "@preact/signals";
import type { SceneDescription, Service } from "../service/service.ts";
import { Fly, type Point } from "./fly.ts";

export class Navigator {
  readonly #fly: Fly;
  readonly vfov = signal(0);
  /** Metres a second. */
  readonly speed = signal(0);
  /** Something has moved the eye since the last step. */
  #hasMoved = true;

  constructor(canvas: HTMLCanvasElement, scene: SceneDescription, _service: Service) {
    const { eye, forward } = scene.start;
    this.#fly = new Fly([...eye], [...forward], (1.4 * scene.eyeHeight) / 1.7);
    this.vfov.value = scene.vfovDeg;
    this.speed.value = this.#fly.speed;
    this.#listen(canvas);
  }

  get eye(): Point {
    return this.#fly.eye;
  }

  /** Camera to world, a unit quaternion. */
  get orientation(): [number, number, number, number] {
    return this.#fly.orientation;
  }

  /** Which way the eye looks, a unit vector of the world. */
  get forward(): Point {
    return this.#fly.forward;
  }

  /** Vertical field of view, degrees. */
  get vfovDeg(): number {
    return this.vfov.peek();
  }

  /** Moves for so many seconds. Gives whether the eye has moved since the last step. */
  step(seconds: number): boolean {
    const hasMoved = this.#fly.step(seconds) || this.#hasMoved;
    this.#hasMoved = false;
    return hasMoved;
  }

  /** Puts the eye at a place, and lets it look along `forward`. */
  goTo(eye: Point, forward: Point): void {
    this.#fly.place(eye, forward);
    this.#hasMoved = true;
  }

  #listen(canvas: HTMLCanvasElement): void {
    addEventListener("keydown", (event) => {
      const isTyping = event.target instanceof HTMLInputElement;
      if (!isTyping && !event.ctrlKey && !event.metaKey && this.#fly.key(event.code, true)) {
        event.preventDefault();
      }
    });
    addEventListener("keyup", (event) => this.#fly.key(event.code, false));
    addEventListener("blur", () => this.#fly.release());
    canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      if (canvas.hasPointerCapture(event.pointerId)) {
        this.#fly.look(-event.movementX, -event.movementY);
        this.#hasMoved = true;
      }
    });
    canvas.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        this.#fly.hasten(-Math.sign(event.deltaY));
        this.speed.value = this.#fly.speed;
      },
      { passive: false },
    );
  }
}
