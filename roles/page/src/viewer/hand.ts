/** How long it takes from a move of the hand until it is drawn. */

const KINDS = ["keydown", "pointermove", "wheel"] as const;

export class Hand {
  /** When a hand has moved that no picture has followed yet. */
  #since: number | undefined;
  /** Milliseconds, of the last picture that followed a hand. */
  latency = 0;

  constructor() {
    for (const kind of KINDS) {
      const note = ({ timeStamp }: Event) => {
        this.#since ??= timeStamp;
      };
      addEventListener(kind, note, { capture: true, passive: true });
    }
  }

  /** The eye was followed. A picture was drawn where it has moved. */
  follow(hasMoved: boolean): void {
    if (hasMoved && this.#since !== undefined) {
      this.latency = performance.now() - this.#since;
    }
    this.#since = undefined;
  }
}
