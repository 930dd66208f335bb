/** The other people on the service: following one of them, and what they say to each other. */

import { signal } from "@preact/signals";
import type { Shown } from "../display/display.ts";
import { forwardOf } from "../navigate/gaze.ts";
import { isParallel } from "../navigate/parallel.ts";
import { isForControl } from "../navigate/typing.ts";
import { messageOf } from "../service/errors.ts";
import {
  type Call,
  type Company,
  called,
  type Here,
  nameOf,
  type Part,
  type PartDetails,
  type Person,
  type PersonPose,
} from "../service/service.ts";
import { centreOf } from "../space/box.ts";
import { distance, lerp, type Point } from "../space/point.ts";
import type { Viewer } from "./viewer.ts";

/** Milliseconds between two exchanges of poses, alone and in company. */
const ALONE = 2000;
const TOGETHER = 200;
/** Keys that move the focus between controls. */
const OF_FOCUS: ReadonlySet<string> = new Set(["Tab", "Shift"]);
/** A person farther away than this many heights of an eye is reached by a jump. */
const JUMP = 10;
/** How long a part that somebody points at is marked, milliseconds. */
const MARKED = 6000;

/** A part that somebody points at. */
export interface PointedOut {
  readonly name: string;
  /** Its middle, metres in the world. */
  readonly at: Point;
}

/** Poses of the followed person at the last two exchanges. */
interface Lead {
  readonly number: number;
  readonly from: PersonPose;
  readonly to: PersonPose;
  readonly at: number;
  /** The eye has got there. */
  readonly isReached: boolean;
}

export class People {
  readonly #viewer: Viewer;
  readonly company = signal<Company>({ you: 0, others: [], isFollowed: false });
  /** The number of the followed person. */
  readonly followed = signal<number | undefined>(undefined);
  /** The part that somebody points at now. */
  readonly pointedOut = signal<PointedOut | undefined>(undefined);
  #lead: Lead | undefined;
  /** The leader's set at which the eye is. */
  #shown: Shown | undefined;
  /** The call to make at the next exchange. */
  #call: Call | undefined;
  /** The newest call that this page has heard. */
  #heard = 0;
  /** Ends the wait for the next exchange. */
  #hurry: () => void = () => {};

  constructor(viewer: Viewer) {
    this.#viewer = viewer;
    void this.#meet();
    // Input on the controls ends following.
    addEventListener("keydown", (event) => {
      if (!isForControl(event) && !OF_FOCUS.has(event.key)) {
        this.follow(undefined);
      }
    });
    viewer.canvas.addEventListener("pointerdown", () => this.follow(undefined));
    viewer.canvas.addEventListener("wheel", () => this.follow(undefined), { passive: true });
    // Nobody waits for the answer, nor would it come.
    addEventListener("pagehide", () => void viewer.service.meet(this.#here(), true).catch(() => {}));
  }

  /** Follows a person, or nobody any more. */
  follow(number: number | undefined): void {
    if (this.followed.peek() === number) {
      return;
    }
    const { navigator } = this.#viewer;
    const wasFree = this.followed.peek() === undefined;
    this.followed.value = number;
    [this.#lead, this.#shown] = [undefined, undefined];
    navigator.isHeld = number !== undefined;
    if (number !== undefined) {
      navigator.setMode("fly");
      this.#lead = this.#leadAt(performance.now());
      if (wasFree) {
        requestAnimationFrame(() => this.#step());
      }
    }
    this.#subscribe();
  }

  /**
   * Ends following. The sections, and the hidden, isolated and see-through objects of the followed person
   * become one's own, in one step of the history.
   */
  goOnAlone(): void {
    const { display, view } = this.#viewer;
    const led = display?.leader === undefined ? undefined : display.shown?.led;
    this.follow(undefined);
    if (led !== undefined) {
      const { sections, hidden, isolated, seeThrough = view.modelSeeThrough } = led;
      view.change({ sections, hidden, isolated, seeThrough });
    }
  }

  /** Asks all others to come here. */
  bringAll(): void {
    this.#say({ here: null });
    this.#viewer.said.value = "The others are asked to come here.";
  }

  /** Marks a part in the pictures of all, with its name. */
  pointOut(part: Pick<Part, "kind" | "id">): void {
    this.#say(part.kind === "object" ? { object: part.id } : { group: part.id });
    void this.#mark(part);
  }

  #say(call: Call): void {
    this.#call = call;
    this.#hurry();
  }

  #hear(others: readonly Person[]): void {
    const heard = this.#heard;
    for (const person of others) {
      const { number = 0, says } = person.call ?? {};
      this.#heard = Math.max(this.#heard, number);
      if (says !== undefined && number > heard) {
        void this.#obey(person, says);
      }
    }
  }

  /** Tells what somebody says. Nobody is moved against their will. */
  async #obey(person: Person, says: Call): Promise<void> {
    const { navigator, offer } = this.#viewer;
    const label = "Go there";
    if ("here" in says) {
      const run = () => {
        this.follow(undefined);
        navigator.jumpTo({ ...person.pose, mode: "fly" });
      };
      offer.value = { text: `${called(person)} asks you to come.`, label, run };
      return;
    }
    const part = await this.#mark(
      "object" in says ? { kind: "object", id: says.object } : { kind: "group", id: says.group },
    );
    if (part !== undefined) {
      const run = () => {
        this.follow(undefined);
        navigator.frame(part.core, part.sides);
      };
      offer.value = { text: `${called(person)} points at ${nameOf(part)}.`, label, run };
    }
  }

  /** Marks a part for a while, and returns its details. */
  async #mark({ kind, id }: Pick<Part, "kind" | "id">): Promise<PartDetails | undefined> {
    const { service, said } = this.#viewer;
    try {
      const part = await service.details({ kind, id });
      const marked = { name: nameOf(part), at: centreOf(part.core) };
      this.pointedOut.value = marked;
      setTimeout(() => {
        if (this.pointedOut.peek() === marked) {
          this.pointedOut.value = undefined;
        }
      }, MARKED);
      return part;
    } catch (error) {
      said.value = messageOf(error);
      return undefined;
    }
  }

  /** Lets the display show the followed person's sets. A display with a new link is told again. */
  #subscribe(): void {
    const person = this.company.peek().others.find(({ number }) => number === this.followed.peek());
    const leader = person?.leader === undefined ? undefined : BigInt(`0x${person.leader}`);
    this.#viewer.display?.follow(leader);
  }

  async #meet(): Promise<void> {
    for (;;) {
      const before = this.company.peek();
      const call = this.#call;
      try {
        this.company.value = await this.#viewer.service.meet(this.#here());
        this.#call = this.#call === call ? undefined : this.#call;
        this.#hear(this.company.peek().others);
        this.#viewer.isFollowed = this.company.peek().isFollowed;
        this.#lead = this.#leadAt(performance.now());
      } catch {
        // The link reports that the service is away.
        this.company.value = { ...this.company.peek(), others: [] };
      }
      const { others } = this.company.peek();
      const followed = this.followed.peek();
      if (followed !== undefined && !others.some(({ number }) => number === followed)) {
        const person = before.others.find(({ number }) => number === followed);
        this.#viewer.said.value = `${called(person ?? { number: followed })} has left.`;
        this.follow(undefined);
      }
      this.#subscribe();
      await new Promise<void>((resolve) => {
        this.#hurry = resolve;
        setTimeout(resolve, others.length === 0 ? ALONE : TOGETHER);
      });
    }
  }

  /** The message to the others. */
  #here(): Here {
    const { display, navigator } = this.#viewer;
    const { eye, forward, vfovDeg } = navigator;
    return {
      pose: { eye, forward, vfovDeg },
      leader: display?.leaderKey?.toString(16),
      follows: display?.leader === undefined ? undefined : this.followed.peek(),
      call: this.#call,
    };
  }

  #leadAt(now: number): Lead | undefined {
    const person = this.company.peek().others.find(({ number }) => number === this.followed.peek());
    if (person === undefined) {
      return undefined;
    }
    const { number, pose: to } = person;
    const before = this.#lead?.number === number ? this.#lead : undefined;
    const isReached = before?.isReached === true && JSON.stringify(before.to) === JSON.stringify(to);
    return { number, from: before?.to ?? to, to, at: now, isReached };
  }

  /** Moves to the followed person's last pose, in the time until the next exchange. */
  #step(): void {
    if (this.followed.peek() === undefined) {
      return;
    }
    requestAnimationFrame(() => this.#step());
    const { display, navigator, scene } = this.#viewer;
    const shown = display?.shown;
    if (display?.leader !== undefined) {
      // The eye is where the shown set was culled for. There is none yet at first.
      if (shown?.led !== undefined && shown !== this.#shown) {
        this.#shown = shown;
        navigator.follow(shown.camera.eye, forwardOf(shown.camera.orientation));
      }
      this.#zoomTo(this.#lead?.to.vfovDeg);
      return;
    }
    const lead = this.#lead;
    if (lead === undefined || lead.isReached) {
      return;
    }
    const { from, to, at } = lead;
    // There is no way between the projections; and in parallel, a far eye goes far.
    const isOther = isParallel(to.vfovDeg) !== isParallel(navigator.vfovDeg);
    const isFar = distance(to.eye, navigator.eye) > JUMP * scene.eyeHeight && !isParallel(to.vfovDeg);
    const isJump = isOther || isFar;
    const share = isJump ? 1 : Math.min(1, (performance.now() - at) / TOGETHER);
    const [eye, forward] = [lerp(from.eye, to.eye, share), lerp(from.forward, to.forward, share)];
    this.#zoomTo(from.vfovDeg + (to.vfovDeg - from.vfovDeg) * share);
    if (isJump) {
      navigator.goTo(eye, forward);
    } else {
      navigator.follow(eye, forward);
    }
    this.#lead = { ...lead, isReached: share === 1 };
  }

  #zoomTo(vfovDeg: number | undefined): void {
    const { navigator } = this.#viewer;
    if (vfovDeg !== undefined && navigator.vfovDeg !== vfovDeg) {
      navigator.setVfov(vfovDeg);
    }
  }
}
