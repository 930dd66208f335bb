/** Viewpoints and sets saved in this browser, by scene. */

import { signal } from "@preact/signals";
import { counted } from "../controls/counted.ts";
import { decodeViewpoint, encodeViewpoint, foreign, type SceneName, type Viewpoint } from "./viewpoint.ts";

export interface KeptViewpoint {
  /** Unique. */
  readonly name: string;
  /** A small picture, as a `data:` address. */
  readonly thumbnail: string;
  readonly viewpoint: Viewpoint;
}

/** A query with a name: a set of all parts of a kind. */
export interface KeptSet {
  /** Unique among sets. */
  readonly name: string;
  readonly query: string;
}

/** The stored form of a viewpoint, or with a query that of a set. */
interface Stored {
  readonly name: string;
  readonly thumbnail: string;
  readonly view: string;
  readonly query?: string;
}

/** The most that are read. */
const MOST = 200;
/** The most letters of a name. */
const LONGEST_NAME = 80;
/** The most letters of a query. */
const LONGEST_QUERY = 2000;

/** A file of viewpoints is invalid. */
export class ViewpointsError extends Error {}

export class KeptViewpoints {
  readonly list = signal<readonly KeptViewpoint[]>([]);
  readonly sets = signal<readonly KeptSet[]>([]);
  readonly #scene: SceneName;
  readonly #key: string;

  /** The viewpoints of a scene. Stored ones that cannot be read are ignored. */
  constructor(scene: SceneName) {
    this.#scene = scene;
    this.#key = `trimaran-viewpoints-${scene.fingerprint}`;
    try {
      const { views, sets } = this.#parse(localStorage.getItem(this.#key) ?? "[]");
      [this.list.value, this.sets.value] = [views, sets];
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

  /** Saves a query as a set, under the name that this returns. Of more than 200 sets the first is dropped. */
  addSet(query: string, name = query): string {
    const sets = this.sets.peek();
    const called = free(name.trim() === "" ? query : name, sets);
    this.#setSets([...sets, { name: called, query }].slice(-MOST));
    return called;
  }

  removeSet(set: KeptSet): void {
    this.#setSets(this.sets.value.filter((one) => one !== set));
  }

  /** As `rename`. */
  renameSet(set: KeptSet, name: string): void {
    const sets = this.sets.peek();
    const others = sets.filter((one) => one !== set);
    if (name.trim() !== "") {
      this.#setSets(sets.map((one) => (one === set ? { ...one, name: free(name, others) } : one)));
    }
  }

  /** All of them as a file. */
  toJson(): string {
    const views = this.list.value.map(({ name, thumbnail, viewpoint }): Stored => {
      return { name, thumbnail, view: encodeViewpoint(viewpoint) };
    });
    return JSON.stringify([...views, ...this.sets.value], undefined, 1);
  }

  /** Adds what is in a file. Throws a `ViewpointsError` and changes nothing if it is invalid. */
  addJson(text: string): void {
    const { views, sets } = this.#parse(text);
    const [list, allSets] = [[...this.list.peek()], [...this.sets.peek()]];
    if (Math.max(list.length + views.length, allSets.length + sets.length) > MOST) {
      const those = counted(views.length, "view");
      const added = sets.length === 0 ? those : `${those} and ${counted(sets.length, "set")}`;
      throw new ViewpointsError(`with its ${added} there would be more than ${MOST}`);
    }
    for (const one of views) {
      list.push({ ...one, name: free(one.name, list) });
    }
    for (const one of sets) {
      allSets.push({ ...one, name: free(one.name, allSets) });
    }
    this.sets.value = allSets;
    this.#set(list);
  }

  #parse(text: string): { readonly views: readonly KeptViewpoint[]; readonly sets: readonly KeptSet[] } {
    let stored: unknown;
    try {
      stored = JSON.parse(text);
    } catch (error) {
      throw new ViewpointsError(`it is not JSON: ${error instanceof Error ? error.message : error}`);
    }
    if (!Array.isArray(stored)) {
      throw new ViewpointsError("it is JSON, but has no list of views. “Save as a file” writes such a list");
    }
    const isSet = (one: Partial<Stored> | null) => typeof one?.query === "string";
    const views = stored.filter((one) => !isSet(one));
    const sets = stored.filter(isSet);
    if (Math.max(views.length, sets.length) > MOST) {
      const [count, what] = views.length > MOST ? [views.length, "views"] : [sets.length, "sets"];
      throw new ViewpointsError(`it has ${count} ${what}: ${MOST} is the most`);
    }
    return { views: this.#viewsOf(views), sets: setsOf(sets) };
  }

  #viewsOf(stored: readonly (Partial<Stored> | null)[]): readonly KeptViewpoint[] {
    return stored.map((one, index) => {
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
    this.#store();
  }

  #setSets(sets: readonly KeptSet[]): void {
    this.sets.value = sets;
    this.#store();
  }

  #store(): void {
    try {
      localStorage.setItem(this.#key, this.toJson());
    } catch {
      // Without storage the browser keeps them as long as the page is open.
    }
  }
}

function setsOf(stored: readonly Partial<Stored>[]): readonly KeptSet[] {
  return stored.map(({ name, query = "" }, index) => {
    if (typeof name !== "string" || name.trim() === "" || query.length > LONGEST_QUERY) {
      const which = typeof name === "string" ? `its set “${name}”` : `its set number ${index + 1}`;
      throw new ViewpointsError(
        `${which} needs a "name", and a "query" of at most ${LONGEST_QUERY} letters, both texts`,
      );
    }
    return { name, query };
  });
}

/** The name, with a number if the list has it already. */
function free(name: string, list: readonly Pick<KeptViewpoint, "name">[]): string {
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
