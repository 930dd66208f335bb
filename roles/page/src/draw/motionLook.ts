/** Whether the picture of a moving eye has lines and dark corners: where they cost no time. */

/** The frames whose median interval says how fast pictures come. */
const FRAMES = 15;
/** How much longer an interval may become by them. */
const LONGER = 1.2;
/** Moving frames after a failed trial until the next one: at first, and at most. */
const SOONEST = 120;
const LATEST = 15_000;

export class MotionLook {
  isOn = false;
  readonly #isPossible: boolean;
  readonly #intervals: number[] = [];
  /** The median interval without them, milliseconds. */
  #usual = 0;
  /** Moving frames until the next trial. */
  #left = 0;
  #pause = SOONEST;

  /** Without a graphics card it is never tried. */
  constructor(isPossible: boolean) {
    this.#isPossible = isPossible;
  }

  /** Takes the time between two pictures of a moving eye, milliseconds. */
  add(interval: number): void {
    if (!this.#isPossible) {
      return;
    }
    this.#left = Math.max(this.#left - 1, 0);
    this.#intervals.push(interval);
    if (this.#intervals.length < FRAMES) {
      return;
    }
    const median = this.#intervals.sort((a, b) => a - b)[FRAMES >> 1] ?? 0;
    this.#intervals.length = 0;
    if (!this.isOn) {
      this.#usual = median;
      this.isOn = this.#left === 0;
    } else if (median > LONGER * this.#usual) {
      this.isOn = false;
      this.#left = this.#pause;
      this.#pause = Math.min(2 * this.#pause, LATEST);
    }
  }

  /** The eye rests: the time until it moves again is no interval. */
  rest(): void {
    this.#intervals.length = 0;
  }
}
