/** Predicts the eye's pose from its recent motion. */

import { directionOf } from "../navigate/gaze.ts";
import { beyond, minus, type Point } from "../space/point.ts";

/** A place and a direction, as of a gaze. */
export interface Pose {
  readonly eye: Point;
  readonly heading: number;
  readonly pitch: number;
  /**
   * The point so many metres before the eye goes steadily. A distant eye of a parallel view swings around it.
   */
  readonly ahead?: number;
}

/** The past from which the future is predicted, milliseconds. */
const PAST = 100;
/** The limit of prediction, milliseconds: by then the hand has done something else. */
const FURTHEST = 250;

/** Follows an eye. Times are milliseconds. */
export class Prediction {
  readonly #past: { readonly at: number; readonly pose: Pose }[] = [];

  /** The eye is here at this time. */
  add(at: number, pose: Pose): void {
    this.#past.push({ at, pose });
    while (this.#past.length > 2 && (this.#past[1]?.at ?? at) <= at - PAST) {
      this.#past.shift();
    }
  }

  /** The eye has jumped, so the past is discarded. */
  forget(): void {
    this.#past.length = 0;
  }

  /** The pose this many milliseconds after the last one; nothing if there is no past. */
  after(ahead: number): Pose | undefined {
    const [first, last] = [this.#past[0], this.#past.at(-1)];
    if (first === undefined || last === undefined) {
      return undefined;
    }
    const past = last.at - first.at;
    const share = past > 0 ? Math.min(ahead, FURTHEST) / past : 0;
    const [a, b] = [first.pose, last.pose];
    // The shorter way round.
    const heading = b.heading + wrapped(b.heading - a.heading) * share;
    const pitch = b.pitch + (b.pitch - a.pitch) * share;
    const [from, to] = [steady(a), steady(b)];
    const { ahead: away = 0 } = b;
    return {
      eye: beyond(beyond(to, minus(to, from), share), directionOf(heading, pitch), -away),
      heading,
      pitch,
    };
  }
}

/** The point that goes steadily. */
function steady({ eye, heading, pitch, ahead = 0 }: Pose): Point {
  return beyond(eye, directionOf(heading, pitch), ahead);
}

/** The same angle between minus and plus half a turn. */
function wrapped(angle: number): number {
  return angle - 2 * Math.PI * Math.round(angle / (2 * Math.PI));
}
