/** A person's intended motion, from keys or a gamepad. */

/** From -1 to 1 each, or more if several inputs add up. */
export interface Motion {
  ahead: number;
  right: number;
  up: number;
  /** To the left. */
  turn: number;
  /** Upwards. */
  tilt: number;
}

export function still(): Motion {
  return { ahead: 0, right: 0, up: 0, turn: 0, tilt: 0 };
}

/** The keys that move the eye while they are held, by their position on the keyboard. */
const KEYS: Readonly<Record<string, readonly [keyof Motion, number]>> = {
  KeyW: ["ahead", 1],
  KeyS: ["ahead", -1],
  KeyD: ["right", 1],
  KeyA: ["right", -1],
  KeyE: ["up", 1],
  KeyQ: ["up", -1],
  Space: ["up", 1],
  KeyC: ["up", -1],
  ArrowLeft: ["turn", 1],
  ArrowRight: ["turn", -1],
  ArrowUp: ["ahead", 1],
  ArrowDown: ["ahead", -1],
  PageUp: ["tilt", 1],
  PageDown: ["tilt", -1],
};

/** The keys that are down. */
export class Keys {
  readonly #held = new Set<string>();
  /** Keys pressed since the last read: a tap between two pictures moves as well. */
  readonly #tapped = new Set<string>();

  /** A key went down or up. Returns whether it moves the eye. */
  press(code: string, isDown: boolean): boolean {
    if (!(code in KEYS) && !code.startsWith("Shift")) {
      return false;
    }
    if (isDown) {
      this.#held.add(code);
      this.#tapped.add(code);
    } else {
      this.#held.delete(code);
    }
    return true;
  }

  /** All keys are up: the page has lost the keyboard. */
  release(): void {
    this.#held.clear();
    this.forget();
  }

  /** Discards taps since the last read. */
  forget(): void {
    this.#tapped.clear();
  }

  /** Whether the eye is to move faster. */
  get isFast(): boolean {
    return this.#held.has("ShiftLeft") || this.#held.has("ShiftRight");
  }

  /** Adds the keys' motion since the last call. */
  add(motion: Motion): void {
    for (const code of new Set([...this.#held, ...this.#tapped])) {
      const [way, sign] = KEYS[code] ?? ["ahead", 0];
      motion[way] += sign;
    }
    this.#tapped.clear();
  }
}

/** The dead zone of a gamepad's sticks. */
const DEAD = 0.15;

/** Adds the first gamepad's motion, by the standard mapping: sticks move and turn, triggers sink and rise. */
export function addGamepad(motion: Motion, gamepads: readonly (Gamepad | null)[]): void {
  const pad = gamepads.find((pad) => pad?.connected && pad.mapping === "standard");
  const stick = (axis: number) => {
    const at = pad?.axes[axis] ?? 0;
    return Math.abs(at) < DEAD ? 0 : (at - Math.sign(at) * DEAD) / (1 - DEAD);
  };
  const trigger = (button: number) => pad?.buttons[button]?.value ?? 0;
  motion.right += stick(0);
  motion.ahead -= stick(1);
  motion.turn -= stick(2);
  motion.tilt -= stick(3);
  motion.up += trigger(7) - trigger(6);
}
