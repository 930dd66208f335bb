/** The service's answers about notes: see `src/page/notes.rs`. */

import type { ObjectSet } from "../proto/objectSet.ts";
import type { Section } from "../proto/viewState.ts";
import type { Service } from "../service/service.ts";
import type { Point } from "../space/point.ts";

export type Status = "open" | "closed";
export type BcfVersion = "2.1" | "3.0";

/** Runs of objects, for `ObjectSet.coded`. */
export type Coded = readonly (readonly [gap: number, more: number])[];

/** A note in the list. */
export interface Note {
  readonly guid: string;
  readonly title: string;
  /** Its other lines, or their beginning. */
  readonly text: string;
  readonly author: string;
  /** As ISO 8601 writes it. */
  readonly date: string;
  readonly status: Status;
  /** The place in the scene, metres; null if it has none. */
  readonly point: Point | null;
  readonly replyCount: number;
}

/** A view to which a note leads. */
export interface NotedView {
  readonly camera: {
    readonly eye: Point;
    readonly forward: Point;
    readonly up: Point;
    /** Vertical field of view, degrees; an orthogonal camera has a height in metres instead. */
    readonly vfovDeg?: number;
    readonly height?: number;
  } | null;
  readonly sections: readonly Section[];
  readonly selected: Coded;
  readonly hidden: Coded;
  /** If set, only these are shown. */
  readonly isolated: Coded | null;
  /** If not those of the model. */
  readonly seeThrough: Coded | null;
  /** How many of its sections and parts cannot be shown. */
  readonly leftOut: number;
}

export interface Reply {
  readonly guid: string;
  readonly author: string;
  readonly date: string;
  readonly text: string;
}

/** A note with all that it has. */
export interface WholeNote extends Note {
  readonly replies: readonly Reply[];
  /** Whether this person may delete it. */
  readonly isOwn: boolean;
  readonly view: NotedView | null;
}

/** All notes. */
export interface NoteList {
  /** It changes with the list. */
  readonly tag: string;
  readonly mayWrite: boolean;
  /** The name by which the service knows the person. */
  readonly you: string | null;
  /** Files that are no notes: a line for each. */
  readonly damaged: readonly string[];
  /** The oldest first. */
  readonly notes: readonly Note[];
}

/** A note to be written. */
export interface Written {
  readonly text: string;
  readonly author: string;
  /** By which this browser may delete it. */
  readonly key: string;
  readonly point: Point | null;
  readonly eye: Point;
  readonly forward: Point;
  readonly up: Point;
  /** Vertical field of view, degrees; of a parallel view, the height in metres. */
  readonly vfovDeg?: number;
  readonly height?: number;
  /** The picture's width, in heights. */
  readonly aspect: number;
  readonly sections: readonly Section[];
  readonly selected: Coded;
  readonly hidden: Coded;
  readonly isolated: Coded | null;
  readonly seeThrough: Coded | null;
  /** A picture in base64; null without one. */
  readonly picture: string | null;
}

/** A change that a person makes to notes. */
export type Change =
  | ({ readonly do: "write" } & Written)
  | { readonly do: "reply"; readonly guid: string; readonly text: string; readonly author: string }
  | { readonly do: "status"; readonly guid: string; readonly status: Status }
  | { readonly do: "delete"; readonly guid: string; readonly key: string };

/** The objects of a set as runs. */
export function coded({ runs }: ObjectSet): Coded {
  return runs.map(({ first, end }, at) => [
    first - (at === 0 ? 0 : (runs[at - 1]?.end ?? 0) + 1),
    end - first - 1,
  ]);
}

/** The list; nothing if it still has this tag. */
export async function list(service: Service, known: string): Promise<NoteList | undefined> {
  const answer = await service.ask("notes", { known });
  return answer.status === 204 ? undefined : ((await answer.json()) as NoteList);
}

export async function whole(service: Service, guid: string, key: string): Promise<WholeNote> {
  return (await (await service.ask("note", { guid, key })).json()) as WholeNote;
}

/** Changes something. Returns the note's GUID. */
export async function change(service: Service, change: Change): Promise<string> {
  return (await (await service.post("notes", JSON.stringify(change))).json()) as string;
}

/** All notes as a BCF file. */
export async function toBcf(service: Service, version: BcfVersion): Promise<Blob> {
  return (await service.ask("notes.bcf", { version })).blob();
}

/** Adds the notes of a BCF file. Returns how many, and what was left out. */
export async function fromBcf(
  service: Service,
  file: Blob,
): Promise<{ readonly notes: number; readonly leftOut: readonly string[] }> {
  return (await (await service.post("notes.bcf", file)).json()) as { notes: number; leftOut: string[] };
}
