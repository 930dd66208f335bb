/** A person's search for clashes, which the service runs. */

import { signal } from "@preact/signals";
import { ghostRest } from "../objects/actions.ts";
import { type Level, placeAt } from "../objects/levels.ts";
import type { Selection } from "../objects/selection.ts";
import { ObjectSet } from "../proto/objectSet.ts";
import { messageOf } from "../service/errors.ts";
import type { Clash, ClashAnswer, ClashPart } from "../service/service.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { measuredOf, type UserView } from "../viewer/viewHistory.ts";

/** Milliseconds between two questions for its progress. */
const PERIOD = 300;
/** The largest tolerance, millimetres. */
const MOST = 1_000_000;

/** Stands between the groups of a path. */
const WITHIN = " > ";

/** Objects that were picked, and what they are called. */
export interface Choice {
  readonly label: string;
  readonly objects: ObjectSet;
}

/** The look of all other objects where a clash is shown. */
export type Rest = "ghosts" | "hidden";

/** The clashes of two groups, the nearest first. */
export interface ClashGroup {
  readonly names: readonly [string, string];
  /** With the names of the groups that both are in. */
  readonly paths: readonly [string, string];
  readonly clashes: readonly Clash[];
}

/** How many clashes were ignored, as they are in the same group of a level. */
export interface Ignored {
  readonly count: number;
  readonly level: string;
}

/** The part of a view that a clash changes. */
type Looks = Pick<UserView, "hidden" | "isolated" | "seeThrough">;

/** The set by which the looks of a clash are known again: each clash makes its own. */
function markOf({ isolated, seeThrough }: Omit<Looks, "hidden">): ObjectSet {
  return isolated ?? seeThrough;
}

export class Clashes {
  /** The sets between which to search. Without a choice: all objects, and all others. */
  readonly between = signal<Choice | undefined>(undefined);
  readonly and = signal<Choice | undefined>(undefined);
  /** The tolerance as it was entered, millimetres. */
  readonly tolerance = signal("5");
  /** The level within whose groups clashes are ignored, and that of the groups by which they are listed. */
  readonly ignore = signal<Level>("Primitive");
  readonly groupBy = signal<Level>("Primitive");
  readonly rest = signal<Rest>("ghosts");
  /** The progress of a search that runs. */
  readonly running = signal<ClashAnswer | undefined>(undefined);
  /** The clashes of the last search; none before the first one. */
  readonly found = signal<readonly Clash[] | undefined>(undefined);
  /** The clashes that the last search has ignored, if it was to. */
  readonly ignored = signal<Ignored | undefined>(undefined);
  /** Why the last search has found nothing. */
  readonly fault = signal("");
  /** The clash that is shown. */
  readonly shown = signal<Clash | undefined>(undefined);
  readonly #viewer: Viewer;
  readonly #selection: Selection;
  #newest = 0;
  /** The looks before those of clashes, by the set that each clash is shown with. */
  readonly #before = new WeakMap<ObjectSet, Looks>();

  constructor(viewer: Viewer, selection: Selection) {
    [this.#viewer, this.#selection] = [viewer, selection];
    addEventListener("pagehide", () => this.cancel(true));
  }

  /** Runs a search in place of the one before. */
  async run(): Promise<void> {
    const tolerance = metresOf(this.tolerance.peek());
    if (tolerance === undefined) {
      this.fault.value = "Enter the tolerance in millimetres, such as 5 or 0.5.";
      return;
    }
    this.#newest += 1;
    const own = this.#newest;
    [this.found.value, this.shown.value, this.fault.value] = [undefined, undefined, ""];
    const level = this.ignore.peek();
    const ignore = level === "Primitive" ? undefined : level.toLowerCase();
    this.running.value = { done: 0, of: 0, isOver: false, total: 0, ignored: 0, clashes: [] };
    try {
      const { found, ignored } = await this.#search(tolerance, ignore, () => own === this.#newest);
      if (own === this.#newest) {
        this.found.value = found;
        this.ignored.value = ignore === undefined ? undefined : { count: ignored, level: ignore };
      }
    } catch (error) {
      if (own === this.#newest) {
        this.fault.value = messageOf(error);
      }
    }
    if (own === this.#newest) {
      this.running.value = undefined;
    }
  }

  /** Ends the search. */
  cancel(isLeaving = false): void {
    if (this.running.peek() !== undefined) {
      this.#newest += 1;
      this.running.value = undefined;
      // The service ends it anyway, once this page asks no more.
      this.#viewer.service.clash({ do: "cancel" }, isLeaving).catch(() => undefined);
    }
  }

  /** Goes to a clash: both objects are solid, and all others ghosts or hidden. One step undoes it. */
  show(clash: Clash): void {
    const { view, navigator, scene } = this.#viewer;
    const objects = clash.parts.map(({ object }) => object);
    const both = ObjectSet.of(objects);
    const now = view.current.peek();
    const before = this.#looksBefore(now);
    const [from, to] = clash.points.map((point) => ({ point, error: clash.error / 2 }));
    const distance = from && to ? [{ from, to, isOfClash: true as const }] : [];
    const hidden = before.hidden.minus(both);
    const looks =
      this.rest.peek() === "ghosts"
        ? { hidden, isolated: undefined, ...ghostRest(both, scene.objects) }
        : { hidden, isolated: ObjectSet.of(objects), seeThrough: before.seeThrough.minus(both) };
    this.#before.set(markOf(looks), before);
    view.change({ ...looks, distances: [...measuredOf(now.distances), ...distance] });
    const { eye, forward, vfov_deg: vfovDeg } = clash.camera;
    // A walker would fall.
    const mode = navigator.mode.peek() === "walk" ? "orbit" : navigator.mode.peek();
    navigator.jumpTo({ eye, forward, vfovDeg, mode });
    this.#selection.pickAll(both);
    this.shown.value = clash;
  }

  /** Gives back the looks before the clashes, unless the person has others since. One step undoes it. */
  leave(): void {
    const { view } = this.#viewer;
    const now = view.current.peek();
    const distances = measuredOf(now.distances);
    if (this.#before.has(markOf(now)) || distances.length < now.distances.length) {
      view.change({ ...this.#looksBefore(now), distances });
    }
  }

  /** The looks of a view without those of a clash. Objects that were hidden meanwhile stay so. */
  #looksBefore({ hidden, isolated, seeThrough }: Looks): Looks {
    const before = this.#before.get(markOf({ isolated, seeThrough }));
    return before === undefined
      ? { hidden, isolated, seeThrough }
      : { ...before, hidden: before.hidden.union(hidden) };
  }

  /** Goes to the clash so many after the shown one. */
  step(by: number): void {
    const found = this.found.peek() ?? [];
    const shown = this.shown.peek();
    const at = shown === undefined ? (by > 0 ? -1 : found.length) : found.indexOf(shown);
    const next = found[at + by];
    if (next !== undefined) {
      this.show(next);
    }
  }

  async #search(
    tolerance: number,
    ignore: string | undefined,
    isWanted: () => boolean,
  ): Promise<{ readonly found: readonly Clash[]; readonly ignored: number }> {
    const { service, scene } = this.#viewer;
    const { between, and } = setsOf(this.between.peek(), this.and.peek(), scene.objects);
    const sets = { between: between.pairs, and: and.pairs };
    let answer = await service.clash({ do: "start", ...sets, tolerance, ignore: ignore ?? null });
    while (!answer.isOver && isWanted()) {
      this.running.value = answer;
      await new Promise((resolve) => setTimeout(resolve, PERIOD));
      answer = isWanted() ? await service.clash({ do: "ask", from: 0 }) : answer;
    }
    const found = [...answer.clashes];
    while (answer.fault === undefined && found.length < answer.total && isWanted()) {
      answer = await service.clash({ do: "ask", from: found.length });
      found.push(...answer.clashes);
    }
    if (answer.fault !== undefined) {
      throw new Error(answer.fault);
    }
    return { found, ignored: answer.ignored };
  }
}

/** The clashes of each pair of groups at a level, in the order of the nearest ones. */
export function groupsOf(clashes: readonly Clash[], level: Level): readonly ClashGroup[] {
  const groups = new Map<string, { names: [string, string]; paths: [string, string]; clashes: Clash[] }>();
  for (const clash of clashes) {
    const [first, second] = clash.parts.map((part) => groupOf(part, level));
    if (first === undefined || second === undefined) {
      continue;
    }
    const key = JSON.stringify([first, second].sort());
    const group = groups.get(key) ?? {
      names: [first.at(-1) ?? "", second.at(-1) ?? ""],
      paths: [first.join(WITHIN), second.join(WITHIN)],
      clashes: [],
    };
    group.clashes.push(clash);
    groups.set(key, group);
  }
  return [...groups.values()];
}

/** The names of an object's group at a level, behind those that it is in. */
function groupOf(part: ClashPart, level: Level): readonly string[] {
  const place = placeAt(part.path, level);
  return place < 0 ? [...part.path, nameOf(part)] : part.path.slice(0, place + 1);
}

/** The name of an object, or its number. */
export function nameOf({ name, object }: ClashPart): string {
  return name || `object ${object}`;
}

/** The sets of a search. Without a choice the first one has all objects, and the second one all others. */
export function setsOf(
  between: Choice | undefined,
  and: Choice | undefined,
  objects: number,
): { readonly between: ObjectSet; readonly and: ObjectSet } {
  const all = ObjectSet.run(0, objects);
  const others = between === undefined ? all : all.minus(between.objects);
  return { between: between?.objects ?? all, and: and?.objects ?? others };
}

/** A tolerance in metres; nothing if the text is not a number of millimetres from 0. */
export function metresOf(text: string): number | undefined {
  const millimetres = /^\s*\d+([.,]\d*)?\s*$/.test(text) ? Number(text.replace(",", ".")) : Number.NaN;
  return millimetres <= MOST ? millimetres / 1000 : undefined;
}

const COLUMNS =
  "kind,distance_m,error_m,name_1,path_1,object_1,name_2,path_2,object_2,x_1,y_1,z_1,x_2,y_2,z_2," +
  "east_1_m,north_1_m,up_1_m,east_2_m,north_2_m,up_2_m,view";

/** The clashes as comma-separated values: the same as those of `trimaran clash`. */
export function csvOf(clashes: readonly Clash[], ignored?: Ignored): string {
  const line = ({ kind, distance, error, parts, points, plant, view }: Clash) => [
    kind,
    distance.toFixed(6),
    error.toExponential(1),
    ...parts.flatMap(({ name, path, object }) => [quoted(name), quoted(path.join(WITHIN)), String(object)]),
    ...[...points, ...plant].flat().map((metres) => metres.toFixed(6)),
    view,
  ];
  const rest = ",".repeat(COLUMNS.split(",").length - 4);
  const last = ignored && `ignored,,,${ignored.count} in the same ${ignored.level}${rest}`;
  const lines = [COLUMNS, ...clashes.map((clash) => line(clash).join(",")), ...(last ? [last] : [])];
  return `${lines.join("\n")}\n`;
}

function quoted(text: string): string {
  return /["\r\n,]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}
