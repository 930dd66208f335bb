/** A flight of the eye from one pose to another. */

import { lerp, type Point } from "../space/point.ts";
import { Gaze } from "./gaze.ts";

/** An eye and its viewing direction. */
export interface Sight {
  readonly eye: Point;
  readonly forward: Point;
}

export class Flight {
  readonly #from: Sight;
  readonly #to: Sight;
  readonly #seconds: number;
  #passed = 0;

  /** A flight that takes this many seconds. */
  constructor(from: Sight, to: Sight, seconds: number) {
    [this.#from, this.#to, this.#seconds] = [from, to, seconds];
  }

  get hasBegun(): boolean {
    return this.#passed > 0;
  }

  get isOver(): boolean {
    return this.#passed >= this.#seconds;
  }

  /** The pose after further `seconds`. It starts and ends slowly, and turns the shorter way. */
  after(seconds: number): Sight {
    this.#passed += seconds;
    if (this.isOver) {
      return this.#to;
    }
    const time = this.#passed / this.#seconds;
    // Perlin's smootherstep: neither speed nor acceleration jumps.
    const share = time ** 3 * (time * (6 * time - 15) + 10);
    const [gaze, end] = [new Gaze(this.#from.forward), new Gaze(this.#to.forward)];
    const left = end.heading - gaze.heading;
    const shorter = left - 2 * Math.PI * Math.round(left / (2 * Math.PI));
    gaze.turn(share * shorter, share * (end.pitch - gaze.pitch));
    return { eye: lerp(this.#from.eye, this.#to.eye, share), forward: gaze.forward };
  }
}
