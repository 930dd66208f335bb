/** Viewpoints saved in this browser, by scene. */

import { signal } from "@preact/signals";
import { decodeViewpoint, encodeViewpoint, foreign, type SceneName, type Viewpoint } from "./viewpoint.ts";

export interface KeptViewpoint {
  /** Unique. */
  readonly name: string;
  /** A small picture, as a `data:` address. */
  readonly thumbnail: string;
  readonly viewpoint: Viewpoint;
}

/** The stored form of one. */
interface Stored {
  readonly name: string;
  readonly thumbnail: string;
  readonly view: string;
}

/** The most that are read. */
const MOST = 200;
/** The most letters of a name. */
const LONGEST_NAME = 80;

/** A file of viewpoints is invalid. */
export class ViewpointsError extends Error {}

export class KeptViewpoints {
  readonly list = signal<readonly KeptViewpoint[]>([]);
  readonly #scene: SceneName;
  readonly #key: string;

  /** The viewpoints of a scene. Stored ones that cannot be read are ignored. */
  constructor(scene: SceneName) {
    this.#scene = scene;
    this.#key = `trimaran-viewpoints-${scene.fingerprint}`;
    try {
      this.list.value = this.#parse(localStorage.getItem(this.#key) ?? "[]");
    } catch {
      // Another version of the page may have stored it.
    }
  }

  /** Saves one more. Without a name it becomes "View 3", or another free number. */
  add({ name = "", thumbnail, viewpoint }: Omit<KeptViewpoint, "name"> & { readonly name?: string }): void {
    const list = this.list.peek();
    this.#set([
      ...list,
      { name: name.trim() === "" ? freeName(list) : free(name, list), thumbnail, viewpoint },
    ]);
  }

  remove(viewpoint: KeptViewpoint): void {
    this.#set(this.list.value.filter((one) => one !== viewpoint));
  }

  /** Renames it; a number may be added to keep names unique. An empty name changes nothing. */
  rename(viewpoint: KeptViewpoint, name: string): void {
    const list = this.list.peek();
    const others = list.filter((one) => one !== viewpoint);
    if (name.trim() !== "") {
      this.#set(list.map((one) => (one === viewpoint ? { ...one, name: free(name, others) } : one)));
    }
  }

  /** All of them as a file. */
  toJson(): string {
    const stored = this.list.value.map(({ name, thumbnail, viewpoint }): Stored => {
      return { name, thumbnail, view: encodeViewpoint(viewpoint) };
    });
    return JSON.stringify(stored, undefined, 1);
  }

  /** Adds the viewpoints of a file. Throws a `ViewpointsError` and changes nothing if it is invalid. */
  addJson(text: string): void {
    const added = this.#parse(text);
    if (this.list.peek().length + added.length > MOST) {
      throw new ViewpointsError(`with its ${added.length} views there would be more than ${MOST}`);
    }
    const list = [...this.list.peek()];
    for (const one of added) {
      list.push({ ...one, name: free(one.name, list) });
    }
    this.#set(list);
  }

  #parse(text: string): readonly KeptViewpoint[] {
    let stored: unknown;
    try {
      stored = JSON.parse(text);
    } catch (error) {
      throw new ViewpointsError(`it is not JSON: ${error instanceof Error ? error.message : error}`);
    }
    if (!Array.isArray(stored)) {
      throw new ViewpointsError("it is JSON, but has no list of views. “Save as a file” writes such a list");
    }
    if (stored.length > MOST) {
      throw new ViewpointsError(`it has ${stored.length} views: ${MOST} is the most`);
    }
    return stored.map((one: Partial<Stored> | null, index) => {
      const which = typeof one?.name === "string" ? `its view “${one.name}”` : `its view number ${index + 1}`;
      if (typeof one?.name !== "string" || typeof one.view !== "string") {
        throw new ViewpointsError(`${which} needs a "name" and a "view", both texts`);
      }
      const viewpoint = decodeViewpoint(one.view);
      if (viewpoint === undefined) {
        throw new ViewpointsError(`the "view" of ${which} is damaged, or of another version of this page`);
      }
      const why = foreign(viewpoint, this.#scene);
      if (why !== undefined) {
        throw new ViewpointsError(`${which}: ${why}`);
      }
      const isPicture = typeof one.thumbnail === "string" && one.thumbnail.startsWith("data:image/");
      return { name: one.name, thumbnail: isPicture ? (one.thumbnail ?? "") : "", viewpoint };
    });
  }

  #set(list: readonly KeptViewpoint[]): void {
    this.list.value = list;
    try {
      localStorage.setItem(this.#key, this.toJson());
    } catch {
      // Without storage the browser keeps them as long as the page is open.
    }
  }
}

/** The name, with a number if the list has it already. */
function free(name: string, list: readonly KeptViewpoint[]): string {
  const taken = new Set(list.map(({ name }) => name));
  const wanted = name.trim().slice(0, LONGEST_NAME);
  let called = wanted;
  for (let number = 2; taken.has(called); number += 1) {
    called = `${wanted} (${number})`;
  }
  return called;
}

/** "View 1", or the first free one behind the last. */
function freeName(list: readonly KeptViewpoint[]): string {
  const numbers = list.map(({ name }) => Number(/^View (\d{1,6})$/.exec(name)?.[1] ?? 0));
  return `View ${Math.max(0, ...numbers) + 1}`;
}
