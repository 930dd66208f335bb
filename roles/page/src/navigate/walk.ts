/** A walking body: it falls, climbs stairs, and does not pass through walls. */

import type { Point } from "../space/point.ts";
import type { Solid } from "./ground.ts";

/** Metres, of a person whose eye is at 1.7 m. Others scale with the eye. */
const EYE = 1.7;
const RADIUS = 0.22;
const HEIGHT = 1.78;
/** The highest step that is climbed. */
const STEP = 0.45;
const JUMP = 0.4;
const GRAVITY = 9.81;
const FASTEST_FALL = 30;
/** The time constant with which the eye follows a step, seconds. */
const SMOOTH = 0.09;

export class Walk {
  /** The position of the feet. */
  feet: Point;
  /** Metres a second upwards. */
  #rise = 0;
  isStanding = false;
  /** Whether there was no floor below when that was last known. */
  isHovering = false;
  /** How far the eye is above its place over the feet. */
  #lag = 0;
  /** The body's size, relative to a person. */
  readonly #scale: number;

  /** A body with this eye height, metres, whose eye is now at `eye`. */
  constructor(eye: Point, eyeHeight: number) {
    this.#scale = eyeHeight / EYE;
    this.feet = [eye[0], eye[1] - eyeHeight, eye[2]];
  }

  get eye(): Point {
    return [this.feet[0], this.feet[1] + EYE * this.#scale + this.#lag, this.feet[2]];
  }

  /** Puts the eye at a place. */
  place(eye: Point): void {
    this.feet = [eye[0], eye[1] - EYE * this.#scale, eye[2]];
    [this.#rise, this.#lag, this.isStanding] = [0, 0, false];
  }

  /** Leaves the ground, if it stands on it. */
  jump(): void {
    if (this.isStanding) {
      this.#rise = Math.sqrt(2 * GRAVITY * JUMP) * this.#scale;
      this.isStanding = false;
    }
  }

  /** Moves this far along x and z, in this many seconds. Returns whether it has moved. */
  step(seconds: number, x: number, z: number, solid: Solid): boolean {
    const before = this.eye;
    // No part of a move is longer than half a column, so nothing is stepped over.
    const parts = Math.max(1, Math.ceil(Math.hypot(x, z) / (0.5 * solid.cell)), Math.ceil(seconds / 0.02));
    for (let part = 0; part < parts; part += 1) {
      this.#go(x / parts, z / parts, solid);
      this.#fall(seconds / parts, solid);
    }
    this.#lag *= Math.exp(-seconds / SMOOTH);
    if (Math.abs(this.#lag) < 1e-4 * this.#scale) {
      this.#lag = 0;
    }
    return this.eye.some((coordinate, axis) => coordinate !== before[axis]);
  }

  /** Moves there, or along a wall in the way. */
  #go(x: number, z: number, solid: Solid): void {
    if (x === 0 && z === 0) {
      return;
    }
    // A body within something may leave it in any direction.
    const isWithin = !this.#fits(this.feet, solid);
    for (const [right, back] of [
      [x, z],
      [x, 0],
      [0, z],
    ] as const) {
      const there: Point = [this.feet[0] + right, this.feet[1], this.feet[2] + back];
      const ground = this.#groundBelow(there, solid);
      if (ground === undefined) {
        continue;
      }
      // Onto a step, if there is room for the head above it.
      const up = Math.max(ground, there[1]);
      if (isWithin || this.#fits([there[0], up, there[2]], solid)) {
        const isStep = this.isStanding && ground > there[1];
        this.#lag -= isStep ? ground - there[1] : 0;
        this.feet = [there[0], isStep ? ground : there[1], there[2]];
        return;
      }
    }
  }

  /** Falls, or stands, or steps down. */
  #fall(seconds: number, solid: Solid): void {
    const ground = this.#groundBelow(this.feet, solid);
    this.isHovering = ground === undefined ? this.isHovering : ground === Number.NEGATIVE_INFINITY;
    // Without any ground nobody falls for ever.
    if (ground === undefined || ground === Number.NEGATIVE_INFINITY) {
      [this.#rise, this.isStanding] = [0, ground !== undefined];
      return;
    }
    if (this.isStanding && this.feet[1] - ground <= STEP * this.#scale) {
      this.#lag += this.feet[1] - ground;
      this.#rest(ground);
      return;
    }
    this.#rise = Math.max(this.#rise - GRAVITY * this.#scale * seconds, -FASTEST_FALL * this.#scale);
    const up = this.feet[1] + this.#rise * seconds;
    const there: Point = [this.feet[0], up, this.feet[2]];
    if (this.#rise > 0 && !this.#fits(there, solid)) {
      this.#rise = 0;
    } else if (up <= ground) {
      this.#rest(ground);
      [this.#rise, this.isStanding] = [0, true];
    } else {
      [this.feet, this.isStanding] = [there, false];
    }
  }

  /** Puts the feet at this height. */
  #rest(height: number): void {
    this.feet = [this.feet[0], height, this.feet[2]];
  }

  /** Whether the body has room at a place: low steps are no obstacle. */
  #fits(feet: Point, solid: Solid): boolean {
    const [low, high] = [feet[1] + STEP * this.#scale, feet[1] + HEIGHT * this.#scale];
    return this.#columns(feet, solid, (spans) => {
      for (let end = 0; end < spans.length; end += 2) {
        if ((spans[end] ?? 0) < high && (spans[end + 1] ?? 0) > low) {
          return false;
        }
      }
      return true;
    });
  }

  /**
   * The highest surface under the body that it can step on; minus infinity if there is none, `undefined` if
   * not known yet.
   */
  #groundBelow(feet: Point, solid: Solid): number | undefined {
    const reach = feet[1] + STEP * this.#scale;
    let ground = Number.NEGATIVE_INFINITY;
    const isKnown = this.#columns(feet, solid, (spans) => {
      for (let end = 1; end < spans.length; end += 2) {
        const top = spans[end] ?? ground;
        if (top <= reach && top > ground) {
          ground = top;
        }
      }
      return true;
    });
    return isKnown ? ground : undefined;
  }

  /** Whether all columns under the body are known and `holds` is true of each. */
  #columns(feet: Point, solid: Solid, holds: (spans: Float64Array) => boolean): boolean {
    const radius = RADIUS * this.#scale;
    const { cell } = solid;
    for (let z = Math.floor((feet[2] - radius) / cell); z * cell < feet[2] + radius; z += 1) {
      for (let x = Math.floor((feet[0] - radius) / cell); x * cell < feet[0] + radius; x += 1) {
        // The point of the column nearest to the axis of the body.
        const right = Math.max(x * cell, Math.min(feet[0], (x + 1) * cell)) - feet[0];
        const back = Math.max(z * cell, Math.min(feet[2], (z + 1) * cell)) - feet[2];
        if (right * right + back * back < radius * radius) {
          const spans = solid.column((x + 0.5) * cell, (z + 0.5) * cell);
          if (spans === undefined || !holds(spans)) {
            return false;
          }
        }
      }
    }
    return true;
  }
}
