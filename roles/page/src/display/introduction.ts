/** Introduces two cullers of a service to each other, so that each draws the other one's visible set. */

import { randomNumber } from "trimaran-transport";
import type { RoleMessage } from "../proto/messages.ts";

/** Milliseconds for the two to connect, and then to be ready. */
const TIMEOUT = 12_000;

/** The outcome: a frame from which they take turns, or nothing. */
type Outcome = { readonly isSwitched: boolean };

export class Introduction {
  readonly #say: (culler: number, message: RoleMessage) => void;
  readonly #onMet: () => number;
  readonly #onOver: (outcome: Outcome) => void;
  readonly #key = randomNumber();
  readonly #endpoint: string;
  #state: "asking" | "meeting" | "switching" | "over" = "asking";
  /** The cullers that have sent the awaited message. */
  readonly #heard = new Set<number>();
  readonly #timer: ReturnType<typeof setTimeout>;

  /**
   * Asks the cullers 0 and 1 to connect at the endpoint of their service. Once they have, `onMet` returns the
   * frame from which they take turns, and sends no more frames until `onOver` is called with the outcome.
   */
  constructor(
    endpoint: string,
    say: (culler: number, message: RoleMessage) => void,
    onMet: () => number,
    onOver: (outcome: Outcome) => void,
  ) {
    [this.#endpoint, this.#say, this.#onMet, this.#onOver] = [endpoint, say, onMet, onOver];
    say(1, { what: "meet", key: this.#key, endpoint: undefined });
    this.#timer = setTimeout(() => this.#giveUp(), TIMEOUT);
  }

  /** A culler has sent a message that may be about it. */
  hear(culler: number, message: RoleMessage): void {
    if (!("key" in message) || message.key !== this.#key || this.#state === "over") {
      return;
    }
    if (message.what === "unmet") {
      this.#giveUp();
    } else if (this.#state === "asking") {
      // A waiting culler that is not needed is turned away.
      if (message.what === "waits") {
        this.#state = "meeting";
        this.#say(0, { what: "meet", key: this.#key, endpoint: this.#endpoint });
      }
    } else if (message.what === (this.#state === "meeting" ? "met" : "switched")) {
      this.#heard.add(culler);
      if (this.#heard.size === 2) {
        this.#heard.clear();
        this.#goOn();
      }
    }
  }

  /** Stops waiting for them. */
  stop(): void {
    clearTimeout(this.#timer);
    this.#state = "over";
  }

  #goOn(): void {
    if (this.#state === "switching") {
      this.stop();
      this.#onOver({ isSwitched: true });
      return;
    }
    this.#state = "switching";
    const firstFrame = this.#onMet();
    for (const culler of [0, 1]) {
      this.#say(culler, { what: "switch", key: this.#key, firstFrame });
    }
  }

  /** They go on independently. */
  #giveUp(): void {
    this.stop();
    for (const culler of [0, 1]) {
      this.#say(culler, { what: "part" });
    }
    this.#onOver({ isSwitched: false });
  }
}
