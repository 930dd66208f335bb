/** A walk with poses interpolated between written ones. */

import type { CameraPath } from "../service/service.ts";
import { distance, lerp, type Point } from "../space/point.ts";

/** Poses a second of a written path. */
const RATE = 30;
/** A step this many times as long as the median one is a jump. */
const JUMP = 10;

export interface Step {
  readonly eye: Point;
  readonly forward: Point;
  /** The eye has jumped here. */
  readonly isJump: boolean;
}

export class Path {
  readonly #frames: CameraPath["frames"];
  readonly #jump: number;

  constructor({ frames }: Pick<CameraPath, "frames">) {
    this.#frames = frames;
    const steps = frames.map((_, at) => this.#step(at)).sort((a, b) => a - b);
    this.#jump = JUMP * (steps[Math.floor(steps.length / 2)] ?? 0);
  }

  /** The duration of the walk. */
  get seconds(): number {
    return this.#frames.length / RATE;
  }

  /** The pose after this many seconds, if the last one was requested at `before`; nothing behind the end. */
  at(seconds: number, before: number): Step | undefined {
    const place = seconds * RATE;
    const at = Math.floor(place);
    const [from, to] = [this.#frames[at], this.#frames[at + 1]];
    if (from === undefined) {
      return undefined;
    }
    let isJump = false;
    for (let passed = Math.floor(before * RATE) + 1; passed <= at; passed += 1) {
      isJump ||= this.#isJump(passed);
    }
    const share = to === undefined || this.#isJump(at + 1) ? 0 : place - at;
    const end = to ?? from;
    return { eye: lerp(from.eye, end.eye, share), forward: lerp(from.forward, end.forward, share), isJump };
  }

  #isJump(at: number): boolean {
    return this.#step(at) > this.#jump;
  }

  /** The distance from the previous pose. */
  #step(at: number): number {
    const [from, to] = [this.#frames[at - 1]?.eye, this.#frames[at]?.eye];
    return from && to ? distance(from, to) : 0;
  }
}
