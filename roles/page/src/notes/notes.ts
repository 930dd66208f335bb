/** The notes on the scene: what the page knows of them, and what a person does with them. */

import { computed, signal } from "@preact/signals";
import { orthogonalOf, poseOf } from "../navigate/parallel.ts";
import type { Selection } from "../objects/selection.ts";
import { ObjectSet } from "../proto/objectSet.ts";
import { messageOf } from "../service/errors.ts";
import { centreOf, sizeOf } from "../space/box.ts";
import type { Point } from "../space/point.ts";
import type { Viewer } from "../viewer/viewer.ts";
import {
  type Change,
  change,
  coded,
  list,
  type Note,
  type NotedView,
  type NoteList,
  type Status,
  type WholeNote,
  whole,
} from "./exchange.ts";
import { snapshotOf } from "./snapshot.ts";

/** Milliseconds between two questions for the list. */
const PERIOD = 1000;
/** The browser's entries for the key by which it may delete its notes, and for the name of a person. */
const KEY = "trimaran-notes-key";
const NAME = "trimaran-notes-name";
/** A gaze this near to straight up or down gets its heading from the picture's upward direction. */
const STEEP = 0.9999;
/** The trace of a heading in a gaze straight up or down. */
const PLUMB = 1e-9;

export class Notes {
  readonly viewer: Viewer;
  readonly #selection: Selection;
  readonly list = signal<NoteList | undefined>(undefined);
  /** The note that a person reads. */
  readonly open = signal<WholeNote | undefined>(undefined);
  /** Filters of the list; empty for all. */
  readonly status = signal<Status | "">("open");
  readonly author = signal("");
  /** The notes that have passed the filters: one that somebody closes stays, and does not seem lost. */
  readonly #met = signal<ReadonlySet<string>>(new Set());
  /** The name that the person has given. */
  readonly name = signal(stored(NAME));
  /** Why the service does not answer. */
  readonly trouble = signal("");
  readonly #key = keptKey();
  #watchers = 0;

  /** The notes that pass the filters, or have passed them, the newest first. */
  readonly shown = computed(() => {
    const [status, author, met] = [this.status.value, this.author.value, this.#met.value];
    const passes = (note: Note) =>
      met.has(note.guid) ||
      ((status === "" || note.status === status) && (author === "" || note.author === author));
    return (this.list.value?.notes ?? []).filter(passes).reverse();
  });

  /** All who have written one. */
  readonly authors = computed(() => {
    return [...new Set((this.list.value?.notes ?? []).map(({ author }) => author))].sort();
  });

  /** The place of what is picked: where it was clicked, or its middle. */
  readonly place = computed<Point | undefined>(() => {
    const bounds = this.#selection.bounds.value;
    return this.#selection.point.value?.point ?? (bounds && centreOf(bounds));
  });

  constructor(viewer: Viewer, selection: Selection) {
    [this.viewer, this.#selection] = [viewer, selection];
  }

  /** Follows the list until the returned function is called. */
  watch(): () => void {
    this.#watchers += 1;
    if (this.#watchers === 1) {
      void this.#follow();
    }
    return () => {
      this.#watchers -= 1;
      if (this.#watchers === 0) {
        this.#met.value = new Set();
      }
    };
  }

  /** Filters the list anew. Empty for all. */
  filter(status: Status | "", author: string): void {
    [this.#met.value, this.status.value, this.author.value] = [new Set(), status, author];
  }

  /** Writes a note about the view as it is. Returns whether the service has kept it. */
  async write(text: string): Promise<boolean> {
    const { navigator, view, canvas, selected } = this.viewer;
    const { eye, forward, vfovDeg, axes } = navigator;
    const point = this.place.peek() ?? this.#ahead() ?? null;
    const camera =
      navigator.projection.peek() === "parallel"
        ? orthogonalOf(eye, forward, point ?? navigator.focus, Math.hypot(...sizeOf(this.viewer.scene)))
        : { eye, vfovDeg };
    const { sections, hidden, isolated, seeThrough } = view.current.peek();
    const guid = await this.#do({
      do: "write",
      text,
      author: this.name.peek().trim(),
      key: this.#key,
      point,
      ...camera,
      forward,
      up: axes[1],
      aspect: canvas.clientWidth / Math.max(1, canvas.clientHeight),
      sections,
      selected: coded(selected.peek()),
      // The hidden ones among isolated ones are not shown either.
      hidden: coded(isolated === undefined ? hidden : ObjectSet.EMPTY),
      isolated: isolated === undefined ? null : coded(isolated.minus(hidden)),
      seeThrough: seeThrough.equals(view.modelSeeThrough) ? null : coded(seeThrough),
      picture: await snapshotOf(this.viewer),
    });
    if (guid === undefined) {
      return false;
    }
    // It passes the filters.
    this.author.value = "";
    if (this.status.peek() === "closed") {
      this.status.value = "";
    }
    await this.read(guid);
    return true;
  }

  /** Replies to the open note. Returns whether the service has kept it. */
  async reply(text: string): Promise<boolean> {
    const guid = this.open.peek()?.guid;
    const author = this.name.peek().trim();
    const isKept = guid !== undefined && (await this.#do({ do: "reply", guid, text, author })) !== undefined;
    if (isKept) {
      await this.read(guid);
    }
    return isKept;
  }

  /** Closes the open note, or opens it again. */
  async setStatus(status: Status): Promise<void> {
    const guid = this.open.peek()?.guid;
    if (guid !== undefined && (await this.#do({ do: "status", guid, status })) !== undefined) {
      await this.read(guid);
    }
  }

  /** Deletes the open note. */
  async delete(): Promise<void> {
    const guid = this.open.peek()?.guid;
    if (guid !== undefined && (await this.#do({ do: "delete", guid, key: this.#key })) !== undefined) {
      this.open.value = undefined;
    }
  }

  /** Opens a note, without moving the eye. Returns it. */
  async read(guid: string): Promise<WholeNote | undefined> {
    return this.attempt(async () => {
      const note = await whole(this.viewer.service, guid, this.#key);
      this.open.value = note;
      return note;
    });
  }

  /** Opens a note, and moves to its view. */
  async goTo(guid: string): Promise<void> {
    const note = await this.read(guid);
    if (note?.view) {
      this.#show(note.view, note.point);
    }
  }

  /** Keeps the person's name for the next time. */
  setName(name: string): void {
    this.name.value = name;
    store(NAME, name);
  }

  /** The result of a request; nothing if it failed, which a message says. */
  async attempt<T>(request: () => Promise<T>): Promise<T | undefined> {
    try {
      return await request();
    } catch (error) {
      this.viewer.said.value = messageOf(error);
      return undefined;
    }
  }

  /** Shows the list as it is now. */
  async refresh(): Promise<void> {
    const before = this.list.peek();
    const now = await list(this.viewer.service, before?.tag ?? "");
    if (now === undefined) {
      return;
    }
    this.#met.value = new Set([...this.#met.peek(), ...this.shown.peek().map(({ guid }) => guid)]);
    this.list.value = now;
    const open = this.open.peek();
    const same = now.notes.find(({ guid }) => guid === open?.guid);
    if (open !== undefined && same === undefined) {
      this.open.value = undefined;
    } else if (open !== undefined && before !== undefined) {
      // Somebody may have replied.
      this.open.value = await whole(this.viewer.service, open.guid, this.#key);
    }
  }

  async #follow(): Promise<void> {
    while (this.#watchers > 0) {
      try {
        await this.refresh();
        this.trouble.value = "";
      } catch (error) {
        this.trouble.value = messageOf(error);
      }
      await new Promise((resolve) => setTimeout(resolve, PERIOD));
    }
  }

  async #do(made: Change): Promise<string | undefined> {
    return this.attempt(async () => {
      const guid = await change(this.viewer.service, made);
      await this.refresh();
      return guid;
    });
  }

  #show({ camera, sections, leftOut, ...sets }: NotedView, point: Point | null): void {
    const { navigator, scene, view, selected, said } = this.viewer;
    if (camera !== null) {
      const mode = navigator.mode.peek();
      const { eye, up, vfovDeg = navigator.vfovDeg, height } = camera;
      const forward = headed(camera.forward, up);
      if (height === undefined) {
        // A walk would fall to the floor.
        navigator.jumpTo({ eye, forward, vfovDeg, mode: mode === "walk" ? "fly" : mode });
      } else {
        navigator.jumpTo(poseOf({ eye, height }, forward, point ?? centreOf(scene.core)));
      }
    }
    view.change({
      sections,
      hidden: ObjectSet.coded(sets.hidden),
      isolated: sets.isolated === null ? undefined : ObjectSet.coded(sets.isolated),
      seeThrough: sets.seeThrough === null ? view.modelSeeThrough : ObjectSet.coded(sets.seeThrough),
    });
    const parts = ObjectSet.coded(sets.selected);
    const first = parts.runs[0]?.first;
    if (first !== undefined && parts.size === 1) {
      void this.#selection.pick({ kind: "object", id: first, first, end: first + 1 });
    } else {
      selected.value = parts;
    }
    if (leftOut > 0) {
      said.value = `The note names ${leftOut} sections or parts that this scene cannot show.`;
    }
  }

  /** The visible point in the middle of the picture. */
  #ahead(): Point | undefined {
    const { clientWidth, clientHeight } = this.viewer.canvas;
    return this.viewer.pointAt(clientWidth / 2, clientHeight / 2);
  }
}

/** The direction with the heading that the picture had: straight down has none. */
export function headed(forward: Point, up: Point): Point {
  const [x, y, z] = forward;
  const across = Math.hypot(up[0], up[2]);
  if (Math.abs(y) <= STEEP * Math.hypot(...forward) || across === 0) {
    return forward;
  }
  const each = (-Math.sign(y) * Math.max(Math.hypot(x, z), PLUMB * Math.abs(y))) / across;
  return [each * up[0], y, each * up[2]];
}

const all = new WeakMap<Viewer, Notes>();

/** The notes of a viewer: one for all that shows them. */
export function notesOf(viewer: Viewer, selection: Selection): Notes {
  const notes = all.get(viewer) ?? new Notes(viewer, selection);
  all.set(viewer, notes);
  return notes;
}

function stored(name: string): string {
  try {
    return localStorage.getItem(name) ?? "";
  } catch {
    return "";
  }
}

function store(name: string, value: string): void {
  try {
    localStorage.setItem(name, value);
  } catch {
    // Without storage it stays as long as the page is open.
  }
}

/** The key of this browser: a new one if it has none. */
function keptKey(): string {
  const kept = stored(KEY);
  if (kept !== "") {
    return kept;
  }
  const bytes = crypto.getRandomValues(new Uint8Array(16));
  const key = Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
  store(KEY, key);
  return key;
}
