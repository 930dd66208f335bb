/** Which culler gets the next camera, and as which frame. */

/** How cullers share frames: each for itself, or two in turn that draw what the other one finds. */
export type Schedule = "independent" | "switch";

/** A camera's way: the number of its culler, counted from 0, and of its frame. */
export interface Dealt {
  readonly culler: number;
  readonly frame: number;
}

export class Dealing {
  /** Frames that each culler was dealt and has not answered. The second one waits in its cell. */
  readonly #hands: readonly number[][];
  /** The frame that each was dealt last. */
  readonly #given: number[];
  #last: number;
  /** Frames go to the cullers in turn, and none is left out. */
  isInTurn = false;
  /** Nothing is dealt for a while. */
  isHeld = false;

  /** The first frame that is dealt comes after `last`. */
  constructor(cullers: number, last: number) {
    this.#hands = Array.from({ length: cullers }, () => []);
    this.#given = this.#hands.map(() => last);
    this.#last = last;
  }

  /** The frame dealt last. */
  get last(): number {
    return this.#last;
  }

  /** Deals a newer camera; nothing where it has to wait until a frame has come. */
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
   * To who is free, or who has waited longest for a camera. If all are busy it waits in the cell of the one
   * that has a camera there, or else of the one that has been busy longest.
   */
  #dealToFree(): Dealt {
    const rank = (hand: readonly number[]) => [0, 2, 1][hand.length] ?? 1;
    const since = (culler: number, hand: readonly number[]) => hand[0] ?? this.#given[culler] ?? 0;
    const order = [...this.#hands.entries()].sort(
      ([one, a], [other, b]) => rank(a) - rank(b) || since(one, a) - since(other, b),
    );
    const [culler, hand] = order[0] ?? [0, []];
    const frame = this.#last + 1;
    // The cell has room for one.
    hand.splice(1, 1, frame);
    [this.#last, this.#given[culler]] = [frame, frame];
    return { culler, frame };
  }

  /** A culler gets a camera when its frame before has come: a newer one in its cell would replace it. */
  #dealInTurn(): Dealt | undefined {
    const frame = this.#last + 1;
    const culler = frame % this.#hands.length;
    const hand = this.#hands[culler];
    if (hand === undefined || hand.length > 0) {
      return undefined;
    }
    hand.push(frame);
    this.#last = frame;
    return { culler, frame };
  }
}
