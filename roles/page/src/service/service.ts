/** The service's HTTP requests beside the link. */

import { randomNumber } from "trimaran-transport";
import type { Box } from "../space/box.ts";
import type { Point } from "../space/point.ts";

/** The service's description of a scene, and the box around it. Lengths in metres. */
export interface SceneDescription extends Box {
  readonly name: string;
  /** The scene's fingerprint, 32 hexadecimal digits. */
  readonly fingerprint: string;
  readonly objects: number;
  /** The box around it without the few objects that lie far from all others. */
  readonly core: Box;
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

/** A point of the model's surface. */
export interface End {
  readonly point: Point;
  /** Its distance from the model's surface is at most this, metres; undefined if unknown. */
  readonly error: number | undefined;
}

export interface Snapped extends End {
  readonly to: "vertex" | "edge" | "face";
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

/** A page's person, for the others. */
export interface Here {
  readonly pose: PersonPose;
  /** The number by which others follow its display, in hexadecimal. */
  readonly leader: string | undefined;
  /** The number of the person whose sets it shows. */
  readonly follows: number | undefined;
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
}

/** What a person is called: names may be the same, numbers are not. */
export function called({ number, name }: Pick<Person, "number" | "name">): string {
  return name === undefined ? `Person ${number}` : `${name} (${number})`;
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
        const answer = await this.#ask("scene", {});
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

  /**
   * Parts with `text` in their name or an attribute, ignoring case and separators; starting at number `from`.
   */
  search(text: string, from: number, signal?: AbortSignal): Promise<Parts> {
    return this.#json("search", { text, from }, signal);
  }

  /** Snaps to a point of full detail; nothing if too much is there, or nothing any more. */
  async snap({ drawable, eye, at, reach }: Aim): Promise<Snapped | undefined> {
    const query = { drawable, eye: eye.join(), at: at.join(), reach };
    return (await this.#json<Snapped | null>("snap", query)) ?? undefined;
  }

  /** The solid spans in a square of the ground: see `navigate/tile.ts`. */
  async tile(x: number, z: number): Promise<ArrayBuffer> {
    return (await this.#ask("tile", { x, z })).arrayBuffer();
  }

  /** Sends what others see of the person, and returns the others. */
  async meet(person: Here): Promise<Company> {
    const body = JSON.stringify({ page: this.#page, ...person });
    const answer = await this.#send(this.#url("people", {}), { method: "POST", body });
    return (await answer.json()) as Company;
  }

  /** The walk for the page to repeat. */
  path(): Promise<CameraPath> {
    return this.#json("drive", {});
  }

  /** Reports on the walk: see `DriveReport` of `src/page/drive.rs`. */
  async report(report: object): Promise<void> {
    await this.#send(this.#url("drive", {}), { method: "POST", body: JSON.stringify(report) });
  }

  async #json<T>(what: string, query: Query, signal?: AbortSignal): Promise<T> {
    return (await (await this.#ask(what, query, signal)).json()) as T;
  }

  async #ask(what: string, query: Query, signal?: AbortSignal): Promise<Response> {
    return this.#send(this.#url(what, query), { signal: signal ?? null });
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

type Query = Readonly<Record<string, string | number>>;
