/** The service's HTTP requests beside the link. */

import { randomNumber } from "trimaran-transport";
import { ObjectSet, type Run } from "../proto/objectSet.ts";
import type { Box } from "../space/box.ts";
import type { PlantFrame } from "../space/plantFrame.ts";
import type { Point } from "../space/point.ts";

/** The service's description of a scene, and the box around it. Lengths in metres. */
export interface SceneDescription extends Box {
  readonly name: string;
  /** The scene's fingerprint, 32 hexadecimal digits. */
  readonly fingerprint: string;
  readonly objects: number;
  /** The plant's coordinates. */
  readonly plant: PlantFrame;
  /** The box around it without the few objects that lie far from all others. */
  readonly core: Box;
  /** Points that a view of all of that must show. */
  readonly outermost: readonly Point[];
  /** The model's see-through objects, for `ObjectSet.coded`. */
  readonly seeThrough: readonly (readonly [gap: number, more: number])[];
  /** Whether there are floors to walk on. */
  readonly hasFloors: boolean;
  readonly eyeHeight: number;
  /** Side of a tile of the heightfield. */
  readonly tileSide: number;
  readonly clearance: number;
  readonly vfovDeg: number;
  readonly start: { readonly eye: Point; readonly forward: Point };
  /** The largest width and height that the service culls for, pixels. */
  readonly maxPicture: readonly [width: number, height: number];
  /** Where cullers of the service connect to each other. */
  readonly meeting: string;
  /** Networks that can be simulated between the page and its culler. */
  readonly networks: readonly { readonly name: string; readonly about: string }[];
  /** How many named groups an object is in, at most: without its file. */
  readonly groupLevels: number;
  /** The origins of pages that may show this one in a frame, and drive it. */
  readonly frameAncestors: readonly string[];
}

/** The service's answer while it cooks the model. */
export interface Cooking {
  /** Its stage, in a word. */
  readonly stage: string;
  readonly done: number;
  /** Zero if it is not known. */
  readonly total: number;
}

/** A part of the model's hierarchy: a group of objects, or an object. */
export interface Part {
  readonly kind: "group" | "object";
  readonly id: number;
  readonly name: string;
  /** Its objects: from `first` to before `end`. */
  readonly first: number;
  readonly end: number;
}

/** A side of a part of the model. */
export interface Side {
  /** The direction from the part to an eye there, a unit vector of the world. */
  readonly from: Point;
  /** The share of the part hidden from there, estimated by boxes. */
  readonly hidden: number;
}

/** A part with the box around it and details. */
export interface PartDetails extends Part, Box {
  /** The groups that it is in, from the outermost. The first one is its file. */
  readonly path: readonly Part[];
  /** The box around it without the few objects that lie far from all others. */
  readonly core: Box;
  /** How much of it is hidden from which sides. */
  readonly sides: readonly Side[];
  /** At full detail. */
  readonly triangles: number;
  readonly attributes: readonly (readonly [name: string, value: string])[];
  /** How many attributes it has; an answer is limited to some of them. */
  readonly attributeCount: number;
}

/** Some of the parts in a question's answer, in order. */
export interface Parts {
  readonly parts: readonly Part[];
  /** How many there are in all. */
  readonly total: number;
}

/** Some of the parts that a query finds. */
export interface FoundParts extends Parts {
  /** How many objects all of them have. */
  readonly objects: number;
  /** The fault of the query. */
  readonly fault?: QueryFault;
}

/** A fault of a query, and its place: from letter `at` to before letter `end`. */
export interface QueryFault {
  readonly text: string;
  readonly at: number;
  readonly end: number;
}

/** The name of an attribute, and how many parts have it. */
export interface AttributeName {
  readonly name: string;
  readonly parts: number;
}

/** The classes of objects by an attribute; `counts` has the number of objects of each class. */
export type ClassLegend =
  | {
      readonly kind: "values";
      readonly labels: readonly string[];
      readonly counts: readonly number[];
      /** How many objects have other values. */
      readonly others: number;
    }
  | {
      /** Steps of one size. */
      readonly kind: "numbers";
      readonly least: number;
      readonly largest: number;
      /** Empty without one. */
      readonly unit: string;
      readonly counts: readonly number[];
      readonly others: number;
    };

/** The classes of objects by an attribute. */
export interface Classes {
  readonly legend: ClassLegend;
  /** Those of each class. */
  readonly objects: readonly ObjectSet[];
}

/** Some rows of a table. */
export interface TableRows {
  readonly csv: string;
  /** The number of the next row, if there is one. */
  readonly next: number | undefined;
}

/** A run of objects in an answer: the first one, how many more there are, and the class. */
type ClassRun = readonly [first: number, more: number, of: number];

/** A point of the model's surface. */
export interface End {
  readonly point: Point;
  /** Its distance from the model's surface is at most this, metres; undefined if unknown. */
  readonly error: number | undefined;
}

export interface Snapped extends End {
  readonly to: "vertex" | "edge" | "face";
  /** A point of the face at the pointer, and its unit normal, if they are known. */
  readonly face?: { readonly point: Point; readonly normal: Point } | null;
}

/** The surface at a pointed-at place, at full detail. */
export interface Surface {
  /** Square metres of the flat face there. */
  readonly area: number;
  /** The cylinder through the round face there, if it is round. Metres. */
  readonly cylinder: { readonly diameter: number; readonly residual: number; readonly length: number } | null;
}

/** A pointed-at place, for asking to snap on full detail. */
export interface Aim {
  /** The visible drawable there. */
  readonly drawable: number;
  readonly eye: Point;
  /** Its visible point. */
  readonly at: Point;
  /** The snapping distance as seen from the eye: metres at that point. */
  readonly reach: number;
}

/** The shortest distance between two parts; `fault` says why there is none. */
export interface Shortest {
  readonly distance: number;
  /** Whether surfaces touch or intersect. */
  readonly isHard: boolean;
  /** The error of the distance. */
  readonly error: number;
  /** A closest point of each part. */
  readonly points: readonly [Point, Point];
  readonly fault?: string;
}

/** Two objects that are too near each other. */
export interface Clash {
  /** Hard if their surfaces touch or intersect. */
  readonly kind: "hard" | "clearance";
  /** The shortest distance, and its error. */
  readonly distance: number;
  readonly error: number;
  readonly parts: readonly [ClashPart, ClashPart];
  /** A closest point of each. */
  readonly points: readonly [Point, Point];
  /** East, north and up of these points. */
  readonly plant: readonly [Point, Point];
  /** An eye that sees it. */
  readonly camera: { readonly eye: Point; readonly forward: Point; readonly vfov_deg: number };
  /** The fragment of an address that shows it. */
  readonly view: string;
}

/** An object of a clash, and the names of the groups around it, from its file. */
export interface ClashPart {
  readonly object: number;
  readonly name: string;
  readonly path: readonly string[];
}

/** A request about this page's search for clashes. Sets are those of `ObjectSet.pairs`. */
export type ClashAct =
  | {
      readonly do: "start";
      readonly between: readonly (readonly [number, number])[];
      readonly and: readonly (readonly [number, number])[];
      /** Metres. */
      readonly tolerance: number;
      /** Pairs in the same group of this level are only counted: `part`, `equipment` or `system`. */
      readonly ignore: string | null;
    }
  | { readonly do: "ask"; readonly from: number }
  | { readonly do: "cancel" };

/** The state of the search. */
export interface ClashAnswer {
  /** How many of all objects of the first set have been compared. */
  readonly done: number;
  readonly of: number;
  readonly isOver: boolean;
  /** How many clashes there are, once it is over; and some of them. */
  readonly total: number;
  /** How many more there are that were to be ignored. */
  readonly ignored: number;
  readonly clashes: readonly Clash[];
  /** Why there are none. */
  readonly fault?: string;
}

/** A walk: poses at 30 a second. Metres and degrees. */
export interface CameraPath {
  readonly vfov_deg: number;
  readonly frames: readonly { readonly eye: Point; readonly forward: Point }[];
}

/** A person's position and view. */
export interface PersonPose {
  readonly eye: Point;
  readonly forward: Point;
  readonly vfovDeg: number;
}

/** A call of a person to all others: to come, or to look at an object or a group. */
export type Call = { readonly here: null } | { readonly object: number } | { readonly group: number };

/** A page's person, for the others. */
export interface Here {
  readonly pose: PersonPose;
  /** The number by which others follow its display, in hexadecimal. */
  readonly leader: string | undefined;
  /** The number of the person whose sets it shows. */
  readonly follows: number | undefined;
  /** The person's call to all others, once. */
  readonly call: Call | undefined;
}

/** The people on the same service. They are numbered as they come. */
export interface Company {
  readonly you: number;
  /** Whether another page shows this one's sets. */
  readonly isFollowed: boolean;
  readonly others: readonly Person[];
}

/** Another person on the service. */
export interface Person {
  readonly number: number;
  /** The name that the service or its proxy knows. */
  readonly name?: string;
  readonly pose: PersonPose;
  /** The number by which the person's display is followed, in hexadecimal. */
  readonly leader?: string;
  /** The person's newest call, for a while. Calls are numbered as they come. */
  readonly call?: { readonly number: number; readonly says: Call };
}

/** What a person is called: names may be the same, numbers are not. */
export function called({ number, name }: Pick<Person, "number" | "name">): string {
  return name === undefined ? `Person ${number}` : `${name} (${number})`;
}

/** The name of a part: few objects have none. */
export function nameOf({ name, kind, id }: Pick<Part, "name" | "kind" | "id">): string {
  return name || `${kind} ${id}`;
}

/** How often the page retries while the service is busy. */
const MOST_TRIES = 5;

/** The status by which the service says that it still cooks the model. */
const COOKING = 202;
/** Milliseconds between two questions for its progress. */
const COOKING_PERIOD = 250;
/** How often the service may give no answer after that: it loads the scene. */
const MOST_LOST = 240;

/** The service has answered with a refusal. */
export class RefusedError extends Error {}

/** The status by which the service refuses a token. */
const FORBIDDEN = 403;
const WRONG_TOKEN =
  "The token in the address is not valid any more. Ask for a new one, or open the address that was printed.";

/** The service from which the page came. Every request throws an explanation if there is no answer. */
export class Service {
  readonly #base: string;
  readonly #token: string;
  /** The page's name for itself: all of its connections share a simulated network. */
  readonly #page = String(randomNumber());

  /** `page` is the address of the page, with the token. */
  constructor(page: string) {
    this.#base = page;
    this.#token = new URL(page).searchParams.get("token") ?? "";
  }

  /** The address of a link, over a simulated network of that name if there is one. */
  link(network: string): string {
    const url = this.#url("link", network === "" ? {} : { network, page: this.#page });
    url.protocol = url.protocol === "https:" ? "wss:" : "ws:";
    return url.href;
  }

  scene(): Promise<SceneDescription> {
    return this.#json("scene", {});
  }

  /** The scene, once its model is cooked. Until then `onCooking` gets the progress. */
  async cooked(onCooking: (cooking: Cooking) => void): Promise<SceneDescription> {
    let lost = 0;
    for (let isCooking = false; ; ) {
      try {
        const answer = await this.ask("scene", {});
        if (answer.status !== COOKING) {
          return (await answer.json()) as SceneDescription;
        }
        [isCooking, lost] = [true, 0];
        onCooking((await answer.json()) as Cooking);
      } catch (error) {
        // A service that has cooked its model opens anew.
        lost += 1;
        if (!isCooking || error instanceof RefusedError) {
          throw error;
        }
        if (lost === MOST_LOST) {
          throw new Error("The service does not answer any more. Where it was started, it says why.");
        }
        onCooking({ stage: "loading", done: 0, total: 0 });
      }
      await new Promise((resolve) => setTimeout(resolve, COOKING_PERIOD));
    }
  }

  details({ kind, id }: Pick<Part, "kind" | "id">): Promise<PartDetails> {
    return this.#json("part", { [kind]: id });
  }

  /** The parts of a group, or without one the files; starting at number `from`. */
  children(group: number | undefined, from = 0): Promise<Parts> {
    return this.#json("children", group === undefined ? { from } : { group, from });
  }

  /** Parts that a query finds (docs/guide/kinds.md has the language), starting at number `from`. */
  search(text: string, from: number, signal?: AbortSignal): Promise<FoundParts> {
    return this.#json("search", { text, from }, signal);
  }

  /** All objects of the parts that a query finds. */
  async objects(text: string): Promise<ObjectSet> {
    const runs: Run[] = [];
    for (let from: number | null = 0; from !== null; ) {
      const answer: { runs: (readonly [number, number])[]; next: number | null } = await this.#json(
        "objects",
        {
          text,
          from,
        },
      );
      runs.push(...answer.runs.map(([first, more]) => ({ first, end: first + more + 1 })));
      from = answer.next;
    }
    return ObjectSet.joined(runs);
  }

  /** The box around most objects that a query finds. */
  box(text: string): Promise<Box> {
    return this.#json("box", { text });
  }

  /** The box around most of these objects. */
  async boxAround(objects: ObjectSet): Promise<Box> {
    return (await (await this.post("box", JSON.stringify(objects.pairs))).json()) as Box;
  }

  /** Rows of the table of all parts that a query finds, from number `from` on: see `src/page/finding`. */
  async rows(text: string, from: number): Promise<TableRows> {
    const answer = await this.ask("rows", { text, from });
    const next = answer.headers.get("next-row");
    // Decoding it as a text would drop the mark at its start.
    const csv = new TextDecoder("utf-8", { ignoreBOM: true }).decode(await answer.arrayBuffer());
    return { csv, next: next === null ? undefined : Number(next) };
  }

  /** The attributes that parts have, those of most parts first. */
  attributes(): Promise<readonly AttributeName[]> {
    return this.#json("attributes", {});
  }

  /** The classes of all objects by an attribute. */
  async classes(attribute: string): Promise<Classes> {
    const runs: Run[][] = [];
    for (let from = 0; ; ) {
      const answer: ClassLegend & { runs: ClassRun[]; next: number | null } = await this.#json("classes", {
        attribute,
        from,
      });
      for (const [first, more, of] of answer.runs) {
        runs[of] ??= [];
        runs[of].push({ first, end: first + more + 1 });
      }
      if (answer.next === null) {
        const objects = answer.counts.map((_, of) => ObjectSet.joined(runs[of] ?? []));
        return { legend: answer, objects };
      }
      from = answer.next;
    }
  }

  /** Snaps to a point of full detail; nothing if too much is there, or nothing any more. */
  async snap({ drawable, eye, at, reach }: Aim): Promise<Snapped | undefined> {
    const query = { drawable, eye: eye.join(), at: at.join(), reach };
    return (await this.#json<Snapped | null>("snap", query)) ?? undefined;
  }

  /** The object at a place, at full detail; nothing if too much is there, or nothing any more. */
  async objectAt({ drawable, eye, at, reach }: Aim): Promise<number | undefined> {
    const query = { drawable, eye: eye.join(), at: at.join(), reach };
    return (await this.#json<number | null>("object", query)) ?? undefined;
  }

  /** The shortest distance between two runs of objects, at full detail. */
  clearance(first: ObjectRun, second: ObjectRun, signal?: AbortSignal): Promise<Shortest> {
    const run = ({ first, end }: ObjectRun) => `${first}-${end}`;
    return this.#json("clearance", { first: run(first), second: run(second) }, signal);
  }

  /** Begins or ends this page's search for clashes, or asks how it is. `isLeaving`: it outlives the page. */
  async clash(act: ClashAct, isLeaving = false): Promise<ClashAnswer> {
    const body = JSON.stringify({ page: this.#page, act });
    const request = { method: "POST", body, keepalive: isLeaving };
    return (await (await this.#send(this.#url("clash", {}), request)).json()) as ClashAnswer;
  }

  /** Measures the surface at a place; nothing if too much is there, or nothing any more. */
  async surface({ drawable, eye, at, reach }: Aim): Promise<Surface | undefined> {
    const query = { drawable, eye: eye.join(), at: at.join(), reach };
    return (await this.#json<Surface | null>("surface", query)) ?? undefined;
  }

  /** The solid spans in a square of the ground: see `navigate/tile.ts`. */
  async tile(x: number, z: number): Promise<ArrayBuffer> {
    return (await this.ask("tile", { x, z })).arrayBuffer();
  }

  /** Sends what others see of the person, and returns the others. If the page `leaves`, it outlives it. */
  async meet(person: Here, leaves = false): Promise<Company> {
    const body = JSON.stringify({ page: this.#page, ...person, leaves });
    const request = { method: "POST", body, keepalive: leaves };
    return (await (await this.#send(this.#url("people", {}), request)).json()) as Company;
  }

  /** The walk for the page to repeat. */
  path(): Promise<CameraPath> {
    return this.#json("drive", {});
  }

  /** Reports on the walk: see `DriveReport` of `src/page/drive.rs`. */
  async report(report: object): Promise<void> {
    await this.post("drive", JSON.stringify(report));
  }

  async #json<T>(what: string, query: Query, signal?: AbortSignal): Promise<T> {
    return (await (await this.ask(what, query, signal)).json()) as T;
  }

  /** The answer to a question. */
  async ask(what: string, query: Query, signal?: AbortSignal): Promise<Response> {
    return this.#send(this.#url(what, query), { signal: signal ?? null });
  }

  /** The answer to a message. */
  async post(what: string, body: string | Blob): Promise<Response> {
    return this.#send(this.#url(what, {}), { method: "POST", body });
  }

  async #send(url: URL, request: RequestInit): Promise<Response> {
    for (let tries = 1; ; tries += 1) {
      const answer = await fetch(url, request);
      if (answer.ok) {
        return answer;
      }
      const seconds = Number(answer.headers.get("retry-after"));
      if (!(answer.status === 503 && seconds > 0) || tries === MOST_TRIES) {
        const isStranger = answer.status === FORBIDDEN;
        throw new RefusedError(isStranger ? WRONG_TOKEN : (await answer.text()).trim());
      }
      await new Promise((resolve) => setTimeout(resolve, 1000 * seconds));
    }
  }

  #url(what: string, query: Query): URL {
    const url = new URL(what, this.#base);
    url.searchParams.set("token", this.#token);
    for (const [name, value] of Object.entries(query)) {
      url.searchParams.set(name, String(value));
    }
    return url;
  }
}

/** Objects from `first` to before `end`. */
type ObjectRun = Pick<Part, "first" | "end">;

type Query = Readonly<Record<string, string | number>>;
