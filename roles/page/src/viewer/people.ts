/** The other people on the service, and following one of them. */

import { signal } from "@preact/signals";
import type { Shown } from "../display/display.ts";
import { forwardOf } from "../navigate/gaze.ts";
import { isForControl } from "../navigate/typing.ts";
import { type Company, called, type PersonPose } from "../service/service.ts";
import { distance, lerp } from "../space/point.ts";
import type { Viewer } from "./viewer.ts";

/** Milliseconds between two exchanges of poses, alone and in company. */
const ALONE = 2000;
const TOGETHER = 200;
/** Keys that move the focus between controls. */
const OF_FOCUS: ReadonlySet<string> = new Set(["Tab", "Shift"]);
/** A person farther away than this many heights of an eye is reached by a jump. */
const JUMP = 10;

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
  #lead: Lead | undefined;
  /** The leader's set at which the eye is. */
  #shown: Shown | undefined;

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

  /** Lets the display show the followed person's sets. A display with a new link is told again. */
  #subscribe(): void {
    const person = this.company.peek().others.find(({ number }) => number === this.followed.peek());
    const leader = person?.leader === undefined ? undefined : BigInt(`0x${person.leader}`);
    this.#viewer.display?.follow(leader);
  }

  async #meet(): Promise<void> {
    for (;;) {
      const { display, navigator, service } = this.#viewer;
      const { eye, forward, vfovDeg } = navigator;
      const before = this.company.peek();
      try {
        const follows = display?.leader === undefined ? undefined : this.followed.peek();
        this.company.value = await service.meet({
          pose: { eye, forward, vfovDeg },
          leader: display?.leaderKey?.toString(16),
          follows,
        });
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
      await new Promise((resolve) => setTimeout(resolve, others.length === 0 ? ALONE : TOGETHER));
    }
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
    const isJump = distance(to.eye, navigator.eye) > JUMP * scene.eyeHeight;
    const share = isJump ? 1 : Math.min(1, (performance.now() - at) / TOGETHER);
    const [eye, forward] = [lerp(from.eye, to.eye, share), lerp(from.forward, to.forward, share)];
    if (isJump) {
      navigator.goTo(eye, forward);
    } else {
      navigator.follow(eye, forward);
    }
    this.#zoomTo(from.vfovDeg + (to.vfovDeg - from.vfovDeg) * share);
    this.#lead = { ...lead, isReached: share === 1 };
  }

  #zoomTo(vfovDeg: number | undefined): void {
    const { navigator } = this.#viewer;
    if (vfovDeg !== undefined && navigator.vfovDeg !== vfovDeg) {
      navigator.setVfov(vfovDeg);
    }
  }
}
