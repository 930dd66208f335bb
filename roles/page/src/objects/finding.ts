/** A query, and what it finds. Parts come page by page, as they are shown. */

import { signal } from "@preact/signals";
import type { ObjectSet } from "../proto/objectSet.ts";
import { messageOf } from "../service/errors.ts";
import { type FoundParts, type Part, RefusedError } from "../service/service.ts";
import type { Viewer } from "../viewer/viewer.ts";

/** The parts of an answer of the service. */
const PAGE = 100;
/** The most pages that are kept. */
const MOST_PAGES = 100;
/** Milliseconds until a query without an answer is asked again. */
const AGAIN = 2000;
const NO_ANSWER = "The service does not answer. The search is repeated until it does.";

/** The result of a query. */
export interface Found extends FoundParts {
  readonly text: string;
}

export class Finding {
  /** The query as it is typed. */
  readonly text = signal("");
  /** The result of the last complete query; none if it is empty. */
  readonly found = signal<Found | undefined>(undefined);
  /** Why the last complete query has no answer; empty if it has one. */
  readonly trouble = signal("");
  /** Whether the list is open. */
  readonly isOpen = signal(false);
  /** Moves the focus to the field of the query. */
  focus: () => void = () => {};
  readonly #viewer: Viewer;
  readonly #pages = new Map<number, readonly Part[]>();
  readonly #loading = new Map<number, Promise<void>>();
  /** Counts the pages that have arrived. */
  readonly #arrived = signal(0);
  #asked: AbortController | undefined;
  #objects: Promise<ObjectSet> | undefined;

  constructor(viewer: Viewer) {
    this.#viewer = viewer;
  }

  /**
   * Searches, after a pause of so many milliseconds. An earlier search is cancelled. Without an answer the
   * list is empty, and the search is repeated until it is cancelled.
   */
  async ask(text: string, pause = 0): Promise<void> {
    this.text.value = text;
    this.cancel();
    const asked = new AbortController();
    this.#asked = asked;
    await new Promise((resolve) => setTimeout(resolve, pause));
    if (asked.signal.aborted) {
      return;
    }
    try {
      const isEmpty = text.trim() === "";
      const answer = isEmpty ? undefined : await this.#viewer.service.search(text, 0, asked.signal);
      if (!asked.signal.aborted) {
        this.#take(answer && { ...answer, text });
      }
    } catch (error) {
      if (!asked.signal.aborted) {
        this.#take(undefined);
        this.trouble.value = error instanceof RefusedError ? messageOf(error) : NO_ANSWER;
        this.isOpen.value = true;
        setTimeout(() => asked.signal.aborted || void this.ask(text), AGAIN);
      }
    }
  }

  /** Searches, shows the list, and moves the focus to it. */
  async show(text: string): Promise<void> {
    await this.ask(text);
    this.focus();
    this.#reopen();
  }

  /** Opens the list again. A query that was cancelled before its answer is asked once more. */
  open(): void {
    const text = this.text.peek();
    if (text !== (this.found.peek()?.text ?? "")) {
      void this.ask(text);
    }
    this.#reopen();
  }

  /** Cancels a search that is under way. */
  cancel(): void {
    this.#asked?.abort();
  }

  close(): void {
    this.cancel();
    this.isOpen.value = false;
  }

  /** A part of the list; nothing until it has arrived, which a component that asks is told. */
  part(index: number): Part | undefined {
    this.#arrived.value;
    const page = this.#pages.get(Math.floor(index / PAGE));
    if (page === undefined && index < (this.found.peek()?.total ?? 0)) {
      void this.#load(Math.floor(index / PAGE));
    }
    return page?.[index % PAGE];
  }

  /** The same, once it has arrived. */
  async arrived(index: number): Promise<Part | undefined> {
    this.part(index);
    await this.#loading.get(Math.floor(index / PAGE));
    return this.part(index);
  }

  /** All objects of all that is found. */
  objects(): Promise<ObjectSet> {
    const text = this.found.peek()?.text ?? "";
    const asking = this.#objects ?? this.#viewer.service.objects(text);
    this.#objects = asking;
    asking.catch(() => {
      // The next command asks again.
      this.#objects = undefined;
    });
    return asking;
  }

  #reopen(): void {
    this.isOpen.value = this.found.peek() !== undefined || this.trouble.peek() !== "";
  }

  #take(found: Found | undefined): void {
    this.#pages.clear();
    this.#loading.clear();
    this.#objects = undefined;
    if (found !== undefined) {
      this.#pages.set(0, found.parts);
    }
    this.found.value = found;
    this.trouble.value = "";
    this.isOpen.value = found !== undefined;
    this.#arrived.value += 1;
  }

  #load(page: number): Promise<void> {
    const known = this.#loading.get(page);
    if (known !== undefined) {
      return known;
    }
    const loading = this.#ask(page);
    this.#loading.set(page, loading);
    return loading;
  }

  async #ask(page: number): Promise<void> {
    const found = this.found.peek();
    try {
      const { parts } = await this.#viewer.service.search(found?.text ?? "", page * PAGE);
      if (this.found.peek() !== found) {
        return;
      }
      this.#pages.set(page, parts);
      const [oldest] = this.#pages.keys();
      if (this.#pages.size > MOST_PAGES && oldest !== undefined) {
        this.#pages.delete(oldest);
        this.#loading.delete(oldest);
      }
      this.#arrived.value += 1;
    } catch (error) {
      this.#loading.delete(page);
      this.#viewer.said.value = messageOf(error);
    }
  }
}
