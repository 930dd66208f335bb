/** Keeps a link to a culler: begins a session, and a new one when it has ended. */

import { type Signal, signal } from "@preact/signals";
import type { LinkEnd } from "trimaran-transport";
import { Display, type DisplayOptions } from "../display/display.ts";
import { messageOf } from "../service/errors.ts";
import { RefusedError, type Service } from "../service/service.ts";
import { troubleJoining, troubleOfEnd } from "./trouble.ts";

/** Milliseconds between attempts: at first, and at most. */
const SOONEST = 250;
const LATEST = 5000;
/** A link counts as established after this many milliseconds. */
const STANDS = 1000;

export class Session {
  readonly #display = signal<Display | undefined>(undefined);
  /** Why there is no link; empty if there is one. */
  readonly trouble = signal("");
  /** How often a link has ended other than by this page. */
  losses = 0;
  /** The simulated network between the page and its culler; empty for none. */
  readonly network: Signal<string>;
  readonly #service: Pick<Service, "link" | "scene">;
  /** The fingerprint of the scene that the page shows. */
  readonly #fingerprint: string;
  /** Ends the wait for the next attempt, or skips it if called before. */
  #hurry: () => void = () => {};
  #isHurried = false;
  readonly #options: () => Omit<DisplayOptions, "onEnd">;
  /** Called once, when the service turns out to have another scene. No more links are made then. */
  readonly #onOtherScene: () => void;

  /** `options` is called for each link. */
  constructor(
    service: Pick<Service, "link" | "scene">,
    fingerprint: string,
    options: () => Omit<DisplayOptions, "onEnd">,
    network: string,
    onOtherScene: () => void,
  ) {
    [this.#service, this.#fingerprint, this.#options] = [service, fingerprint, options];
    [this.network, this.#onOtherScene] = [signal(network), onOtherScene];
    void this.#keep();
  }

  /** The display, which a signal of the page follows. It stays without a link, with its geometry. */
  get display(): Display | undefined {
    return this.#display.value;
  }

  /** Reconnects over another simulated network, keeping the geometry. */
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
        const url = this.#service.link(this.network.peek());
        const display = await Display.join(url, options, this.#display.peek());
        if (display.outline.hash !== BigInt(`0x${this.#fingerprint}`)) {
          display.leave();
          this.#onOtherScene();
          return;
        }
        this.#display.value = display;
        // A service may end a link at once, with a reason.
        const stands = setTimeout(() => {
          this.trouble.value = "";
          pause = SOONEST;
        }, STANDS);
        const end = await over;
        clearTimeout(stands);
        this.trouble.value = troubleOfEnd(end);
        this.losses += this.trouble.peek() === "" ? 0 : 1;
      } catch (error) {
        const why = await this.#why(error);
        if (why === undefined) {
          this.#onOtherScene();
          return;
        }
        this.trouble.value = why;
      }
      await new Promise<void>((resolve) => {
        this.#hurry = resolve;
        setTimeout(resolve, this.#isHurried ? 0 : pause);
      });
      this.#isHurried = false;
    }
  }

  /** Why there was no link, for a person; nothing if the service has another scene. */
  async #why(error: unknown): Promise<string | undefined> {
    try {
      const { fingerprint } = await this.#service.scene();
      return fingerprint === this.#fingerprint ? troubleJoining(error) : undefined;
    } catch (refused) {
      // Browsers hide why a WebSocket has failed. The answer to an HTTP request says more.
      return refused instanceof RefusedError
        ? messageOf(refused)
        : "The service does not answer. The page goes on with what it has, and tries again.";
    }
  }
}
