/** A walk whose poses lie between those that are written down. */

import type { Point } from "../navigate/gaze.ts";
import type { CameraPath } from "../service/service.ts";
import { lerp } from "../tools/projection.ts";

/** Poses a second of a written path. */
const RATE = 30;
/** A step that is so many times as long as the usual one is a jump. */
const JUMP = 10;

export interface Step {
  readonly eye: Point;
  readonly forward: Point;
  /** Nobody has gone here: the eye was elsewhere before. */
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

  /** How long the walk takes. */
  get seconds(): number {
    return this.#frames.length / RATE;
  }

  /** The pose after so many seconds, where the last one was asked for at `before`; nothing behind the end. */
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
    const [eye, forward] = [lerp(from.eye, end.eye, share), lerp(from.forward, end.forward, share)];
    return { eye: [...eye], forward: [...forward], isJump };
  }

  #isJump(at: number): boolean {
    return this.#step(at) > this.#jump;
  }

  /** How far it is to a pose from the one before. */
  #step(at: number): number {
    const [from, to] = [this.#frames[at - 1]?.eye, this.#frames[at]?.eye];
    return from && to ? Math.hypot(to[0] - from[0], to[1] - from[1], to[2] - from[2]) : 0;
  }
}
