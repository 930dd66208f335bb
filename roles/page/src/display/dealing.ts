/** Distributes cameras: selects the culler and the frame number of each. */

/** How cullers share frames: each independently, or two in turn, each drawing the other one's visible set. */
export type Schedule = "independent" | "switch";

/** The destination of a camera: the numbers of its culler, counted from 0, and of its frame. */
export interface Dealt {
  readonly culler: number;
  readonly frame: number;
}

export class Dealing {
  /** Frames sent to each culler and not answered yet. The second one waits in its cell. */
  readonly #hands: readonly number[][];
  /** The last frame sent to each. */
  readonly #given: number[];
  /** The last frame sent. */
  last: number;
  /** Frames go to the cullers in turn, and none is left out. */
  isInTurn = false;
  /** Nothing is sent for a while. */
  isHeld = false;

  /** The first frame comes after `last`. */
  constructor(cullers: number, last: number) {
    this.#hands = Array.from({ length: cullers }, () => []);
    this.#given = this.#hands.map(() => last);
    this.last = last;
  }

  /** Sends a newer camera; nothing if it has to wait until a frame has come. */
  deal(): Dealt | undefined {
    if (this.isHeld) {
      return undefined;
    }
    return this.isInTurn ? this.#dealInTurn() : this.#dealToFree();
  }

  /** A frame has come. */
  came(culler: number, frame: number): void {
    const hand = this.#hands[culler];
    hand?.splice(0, hand.filter((dealt) => dealt <= frame).length);
  }

  /**
   * To a free culler, the one that has waited longest for a camera. If all are busy, the camera waits in the
   * cell of the one that has a camera there, or else of the one busy longest.
   */
  #dealToFree(): Dealt {
    const rank = (hand: readonly number[]) => [0, 2, 1][hand.length] ?? 1;
    const since = (culler: number, hand: readonly number[]) => hand[0] ?? this.#given[culler] ?? 0;
    const order = [...this.#hands.entries()].sort(
      ([one, a], [other, b]) => rank(a) - rank(b) || since(one, a) - since(other, b),
    );
    const [culler, hand] = order[0] ?? [0, []];
    const frame = this.last + 1;
    // The cell has room for one.
    hand.splice(1, 1, frame);
    [this.last, this.#given[culler]] = [frame, frame];
    return { culler, frame };
  }

  /** A culler gets a camera when its previous frame has come: a newer one in its cell would replace it. */
  #dealInTurn(): Dealt | undefined {
    const frame = this.last + 1;
    const culler = frame % this.#hands.length;
    const hand = this.#hands[culler];
    if (hand === undefined || hand.length > 0) {
      return undefined;
    }
    hand.push(frame);
    this.last = frame;
    return { culler, frame };
  }
}
