/** The way of messages between this page and the page around it. */

import type { Message, Request } from "../../../../examples/embedding/trimaran.d.ts";
import { messageOf } from "../service/errors.ts";
import { idOf, isMeant, parseRequest, VERSION } from "./requests.ts";

/** The window around this one. */
export interface Around {
  postMessage(message: unknown, origin: string): void;
}

/** A message from any window. */
export type Heard = Pick<MessageEvent, "origin" | "source" | "data">;

/** A message without its version. */
export type Event = Message extends infer One ? (One extends Message ? Omit<One, "trimaran"> : never) : never;

/**
 * Hears requests of the window around this one, if its origin is an allowed one, and runs one after the
 * other. Messages of all others are dropped without an answer, and are told nothing.
 */
export class Gate {
  readonly #around: Around;
  readonly #origins: readonly string[];
  readonly #run: (request: Request) => Promise<{ readonly picture?: Blob }>;
  /** The request that runs, and those that wait. */
  #running: Promise<void> = Promise.resolve();

  constructor(
    around: Around,
    origins: readonly string[],
    run: (request: Request) => Promise<{ readonly picture?: Blob }>,
  ) {
    [this.#around, this.#origins, this.#run] = [around, origins, run];
  }

  hear({ origin, source, data }: Heard): void {
    if ((source as unknown) !== this.#around || !this.#origins.includes(origin) || !isMeant(data)) {
      return;
    }
    this.#running = this.#running.then(async () => {
      try {
        const request = parseRequest(data);
        this.send({ event: "done", id: request.id, ...(await this.#run(request)) });
      } catch (error) {
        const id = idOf(data);
        this.send({ event: "error", ...(id === undefined ? {} : { id }), message: messageOf(error) });
      }
    });
  }

  /** The browser hands it on only if the window around has one of the origins. */
  send(event: Event): void {
    for (const origin of this.#origins) {
      this.#around.postMessage({ trimaran: VERSION, ...event }, origin);
    }
  }
}

/** The allowed origins that the window around can have: browsers tell its origin, but not all of them. */
export function possibleOrigins(
  allowed: readonly string[],
  ancestors: ArrayLike<string> | undefined,
): readonly string[] {
  const around = ancestors?.[0];
  return around === undefined ? allowed : allowed.filter((origin) => origin === around);
}
