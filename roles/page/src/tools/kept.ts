/** Viewpoints that are kept in this browser, by the scene. */

import { signal } from "@preact/signals";
import { decodeViewpoint, encodeViewpoint, type Viewpoint } from "./viewpoint.ts";

export interface KeptViewpoint {
  readonly name: string;
  /** A small picture, as a `data:` address. */
  readonly thumbnail: string;
  readonly viewpoint: Viewpoint;
}

/** What is stored of one. */
interface Stored {
  readonly name: string;
  readonly thumbnail: string;
  readonly view: string;
}

/** The most that are read. */
const MOST = 200;

/** A file of viewpoints is not what it should be. */
export class ViewpointsError extends Error {}

export class KeptViewpoints {
  readonly list = signal<readonly KeptViewpoint[]>([]);
  readonly #key: string;

  /**
   * Those of the scene with this fingerprint. What is stored and cannot be read is as if it were not there.
   */
  constructor(fingerprint: string) {
    this.#key = `trimaran-viewpoints-${fingerprint}`;
    try {
      this.list.value = parse(localStorage.getItem(this.#key) ?? "[]");
    } catch {
      // Another version of the page may have stored it.
    }
  }

  add(viewpoint: KeptViewpoint): void {
    this.#set([...this.list.value, viewpoint]);
  }

  remove(viewpoint: KeptViewpoint): void {
    this.#set(this.list.value.filter((one) => one !== viewpoint));
  }

  /** All of them as a file. */
  toJson(): string {
    const stored = this.list.value.map(({ name, thumbnail, viewpoint }): Stored => {
      return { name, thumbnail, view: encodeViewpoint(viewpoint) };
    });
    return JSON.stringify(stored, undefined, 1);
  }

  /** Adds those of a file. Throws a `ViewpointsError` where it is none, and changes nothing then. */
  addJson(text: string): void {
    this.#set([...this.list.value, ...parse(text)]);
  }

  #set(list: readonly KeptViewpoint[]): void {
    this.list.value = list;
    try {
      localStorage.setItem(this.#key, this.toJson());
    } catch {
      // A browser that stores nothing keeps them as long as the page is open.
    }
  }
}

function parse(text: string): readonly KeptViewpoint[] {
  let stored: unknown;
  try {
    stored = JSON.parse(text);
  } catch (error) {
    throw new ViewpointsError(`this is no JSON: ${error instanceof Error ? error.message : error}`);
  }
  if (!Array.isArray(stored) || stored.length > MOST) {
    throw new ViewpointsError(`viewpoints are a list of at most ${MOST}`);
  }
  return stored.map((one: Partial<Stored> | null, index) => {
    const viewpoint = typeof one?.view === "string" ? decodeViewpoint(one.view) : undefined;
    if (typeof one?.name !== "string" || viewpoint === undefined) {
      throw new ViewpointsError(`viewpoint ${index} needs a name and a view`);
    }
    const isPicture = typeof one.thumbnail === "string" && one.thumbnail.startsWith("data:image/");
    return { name: one.name, thumbnail: isPicture ? (one.thumbnail ?? "") : "", viewpoint };
  });
}
