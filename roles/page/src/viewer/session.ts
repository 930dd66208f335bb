/** Keeps a link to a culler: begins a session with it, and another one when that has ended. */

import { type Signal, signal } from "@preact/signals";
import { Display, type DisplayOptions } from "../display/display.ts";

/** Milliseconds between attempts: at first, and at most. */
const SOONEST = 250;
const LATEST = 5000;

export class Session {
  readonly #display = signal<Display | undefined>(undefined);
  /** Why there is no link; empty where there is one. */
  readonly trouble = signal("");
  /** The simulated network between the page and its culler; none where it is empty. */
  readonly network: Signal<string>;
  readonly #url: (network: string) => string;
  /** Ends the wait for the next attempt, which is not waited for at all where it is called before. */
  #hurry: () => void = () => {};
  #isHurried = false;
  readonly #options: () => Omit<DisplayOptions, "onEnd">;

  /** `url` and `options` are asked for anew for each link. */
  constructor(
    url: (network: string) => string,
    options: () => Omit<DisplayOptions, "onEnd">,
    network: string,
  ) {
    [this.#url, this.#options, this.network] = [url, options, signal(network)];
    void this.#keep();
  }

  /**
   * The display, which a signal of the page follows; also while it has no link: it goes on with what it has.
   */
  get display(): Display | undefined {
    return this.#display.value;
  }

  /** Goes on over another simulated network, with what is there. */
  moveTo(network: string): void {
    this.network.value = network;
    this.#isHurried = true;
    this.leave();
    this.#hurry();
  }

  leave(): void {
    this.#display.peek()?.leave();
  }

  async #keep(): Promise<void> {
    for (let pause = SOONEST; ; pause = Math.min(2 * pause, LATEST)) {
      try {
        let ended: () => void = () => {};
        const over = new Promise<void>((resolve) => {
          ended = resolve;
        });
        const options = { ...this.#options(), onEnd: () => ended() };
        this.#display.value = await Display.join(
          this.#url(this.network.peek()),
          options,
          this.#display.peek(),
        );
        this.trouble.value = "";
        await over;
        pause = SOONEST;
      } catch (error) {
        const why = error instanceof Error ? error.message : error;
        this.trouble.value = `The service does not answer: ${why}`;
      }
      await new Promise<void>((resolve) => {
        this.#hurry = resolve;
        setTimeout(resolve, this.#isHurried ? 0 : pause);
      });
      this.#isHurried = false;
    }
  }
}
