/** Keeps a link to a culler: begins a session with it, and another one when that has ended. */

import { type Signal, signal } from "@preact/signals";
import { Display, type DisplayOptions } from "../display/display.ts";
import type { LinkEnd } from "../wire/link.ts";
import { troubleJoining, troubleOfEnd } from "./trouble.ts";

/** Milliseconds between attempts: at first, and at most. */
const SOONEST = 250;
const LATEST = 5000;
/** A link that has held for so many milliseconds is one. */
const STANDS = 1000;

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
        let ended: (end: LinkEnd) => void = () => {};
        const over = new Promise<LinkEnd>((resolve) => {
          ended = resolve;
        });
        const options = { ...this.#options(), onEnd: (end: LinkEnd) => ended(end) };
        this.#display.value = await Display.join(
          this.#url(this.network.peek()),
          options,
          this.#display.peek(),
        );
        // A service may end a link at once, and say why.
        const stands = setTimeout(() => {
          this.trouble.value = "";
          pause = SOONEST;
        }, STANDS);
        const end = await over;
        clearTimeout(stands);
        this.trouble.value = troubleOfEnd(end);
      } catch (error) {
        this.trouble.value = troubleJoining(error);
      }
      await new Promise<void>((resolve) => {
        this.#hurry = resolve;
        setTimeout(resolve, this.#isHurried ? 0 : pause);
      });
      this.#isHurried = false;
    }
  }
}
