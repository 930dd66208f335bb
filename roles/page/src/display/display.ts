/**
 * The display's part of a session: it sends cameras to a culler, and gets back visible sets and missing
 * geometry. It can draw what has arrived at any time, from the newest pose.
 */

import {
  type Bytes,
  connect,
  type Frame,
  type LaneName,
  type LinkEnd,
  LinkError,
  type LinkOf,
  perLane,
  randomNumber,
  WireError,
} from "trimaran-transport";
import type { Camera } from "../proto/camera.ts";
import { faultOfIds } from "../proto/idCoding.ts";
import { CloseCode, type Outline, TRIMARAN } from "../proto/identity.ts";
import { type RoleMessage, viewMessages } from "../proto/messages.ts";
import { loadCodecs } from "../proto/piece.ts";
import type { DrawableRecord } from "../proto/records.ts";
import type { Settings } from "../proto/settings.ts";
import { type DisplayItem, dropped, holds, lacks, packBlocks } from "../proto/supply.ts";
import { type ViewState, viewStateOf } from "../proto/viewState.ts";
import { Dealing, type Schedule } from "./dealing.ts";
import { Following } from "./following.ts";
import { Holdings, type Store } from "./holdings.ts";
import { Introduction } from "./introduction.ts";
import { RecentSets } from "./recentSets.ts";
import { Timeline } from "./timeline.ts";

/** How many bytes may come before a frame needs them. */
const AHEAD = 256 << 10;
/** How many frames wait for their geometry: the first ones and the newest. */
const WAITING = 8;

export interface DisplayOptions {
  readonly settings: Settings;
  /** The size limit of unpacked geometry, bytes. */
  readonly memory: number;
  readonly store: Store;
  /** How many cullers, and how they share frames. */
  readonly cullers: number;
  readonly schedule: Schedule;
  /** Where cullers of the service connect to each other. */
  readonly meeting: string;
  readonly onEnd: (end: LinkEnd) => void;
}

/** A link to a culler. */
type CullerLink = LinkOf<typeof TRIMARAN>;

/** A pose to cull for. */
type Pose = Omit<Camera, "frame" | "viewState">;

/** A set of drawables that a culler has found for a camera. */
interface FoundSet {
  readonly camera: Camera;
  /** When the camera was published. */
  readonly posed: number;
  readonly isForeseen: boolean;
  /** The leader's view state, if it is a leader's set. */
  readonly led: ViewState | undefined;
  readonly ids: Uint32Array;
  lacking: Uint32Array;
}

/** The set to draw. */
export interface Shown {
  /** Its camera. */
  readonly camera: Camera;
  readonly drawables: readonly DrawableRecord[];
  /** The part of it that was found for this camera. */
  readonly found: readonly DrawableRecord[];
  /** When the camera was published, by `performance.now()`. */
  readonly posed: number;
  /** Whether it has no stand-ins. */
  readonly isExact: boolean;
  /** The leader's view state, if the display follows another one. */
  readonly led: ViewState | undefined;
}

export class Display {
  /** To each culler; the first one sends geometry as well. */
  readonly #links: readonly CullerLink[];
  readonly #dealing: Dealing;
  readonly #introduction: Introduction | undefined;
  /** A request that could not be sent yet. */
  #owed: { readonly pose: Pose; readonly isForeseen: boolean } | undefined;
  readonly holdings: Holdings;
  readonly #waiting: FoundSet[] = [];
  /** Published frames by number: when, and whether the pose is a prediction. */
  readonly #asked = new Map<number, { readonly at: number; readonly isForeseen: boolean }>();
  /** The set to draw now; nothing before the first one has come. */
  shown: Shown | undefined;
  /** The newest set that was complete, or with stand-ins for everything missing. */
  #whole: readonly number[] | Uint32Array | undefined;
  readonly #recent = new RecentSets();
  #due: DisplayItem[] = [];
  #isDue = false;
  /** Bytes of received blocks, and how many the culler knows of. */
  #taken = 0;
  #confirmed = 0;
  readonly #onEnd: (end: LinkEnd) => void;
  /** It requests nothing any more. */
  isOver = false;
  #frame: number;
  /** The newest frame whose ids have come. */
  #newestFound = 0;
  #view: { version: number; state: ViewState };
  /** Milliseconds from a camera to its set, of the newest set that came. */
  latency = 0;
  /** When the newest set came. */
  #came = 0;
  /** Milliseconds between the newest set and the one before: a busy culler takes that long. */
  interval = 0;
  /** Milliseconds from a camera until its missing geometry arrived, for the newest set that lacked some. */
  geometryLatency = 0;
  readonly timeline = new Timeline();
  readonly #following = new Following();
  /** Whether the frames taken last were a leader's. */
  #isLed = false;
  readonly #leaderKey = randomNumber();
  /** Cameras that were published, and ids that came. */
  readonly counts = { cameras: 0, ids: 0 };

  private constructor(
    links: readonly CullerLink[],
    holdings: Holdings,
    options: DisplayOptions,
    last: number,
  ) {
    [this.#links, this.holdings, this.#frame, this.#onEnd] = [links, holdings, last, options.onEnd];
    this.#dealing = new Dealing(links.length, last);
    this.#view = { version: 0, state: viewStateOf(options.settings) };
    if (options.schedule === "switch" && links.length === 2) {
      this.#introduction = this.#introduce(options.meeting);
    }
    this.#say([...holds(...holdings.all()), { item: "begin", coarserFirst: true, ahead: AHEAD }]);
  }

  /**
   * Connects to its cullers at `url`, and begins a session with each. For the same scene it keeps the
   * geometry of the display `before`, and shows that until newer arrives. It ends with its first link.
   */
  static async join(url: string, options: DisplayOptions, before?: Display): Promise<Display> {
    await loadCodecs();
    const links = await connectAll(options.cullers, () => {
      // A fresh key: this is not a display that reconnects.
      const session = { key: randomNumber(), settings: options.settings };
      return connect(url, TRIMARAN, {
        hello: { role: "display", scene: undefined, session },
        admit: ({ role, scene }) =>
          role === "culler" && scene !== undefined ? undefined : "a display needs a culler with a scene",
        maxItems: ({ scene }) => scene?.drawables ?? 0,
      });
    });
    const outline = links[0]?.peer.scene;
    if (outline === undefined) {
      throw new WireError("the culler did not say which scene it has");
    }
    const kept = before?.outline.hash === outline.hash ? before : undefined;
    const holdings = kept?.holdings ?? new Holdings(outline, options.store, options.memory);
    holdings.beginAnew();
    // Earlier frames are not mistaken for those of these links.
    const display = new Display(links, holdings, options, kept === undefined ? 0 : kept.#frame + 1);
    if (kept !== undefined) {
      [display.shown, display.#whole] = [kept.shown, kept.#whole];
    }
    display.#listen();
    display.#lead();
    return display;
  }

  get outline(): Outline {
    return this.holdings.outline;
  }

  /** The traffic of each lane, over all links. */
  get bytes(): Readonly<Record<LaneName, Bytes>> {
    return perLane((lane) => {
      const all = this.#links.map(({ bytes }) => bytes[lane]);
      const add = (of: keyof Bytes) => all.reduce((bytes, one) => bytes + one[of], 0);
      return { sent: add("sent"), received: add("received") };
    });
  }

  /** How many cullers there are, and whether they take turns. */
  get cullers(): { readonly count: number; readonly isInTurn: boolean } {
    return { count: this.#links.length, isInTurn: this.#dealing.isInTurn };
  }

  /** Whether the shown set belongs to the newest camera, and is complete. */
  get isSettled(): boolean {
    const { shown } = this;
    const isNewest = shown?.camera.frame === this.#frame && this.#owed === undefined;
    // A leader's numbers are not the display's own.
    const isLed = shown?.led !== undefined;
    return shown?.isExact === true && (this.leader === undefined ? isNewest && !isLed : isLed);
  }

  /**
   * Requests the visible set from here, replacing a pose not culled yet. For a predicted pose, recently
   * visible drawables are shown as well. Returns the frame's number; nothing if it must wait for another
   * frame.
   */
  publish(pose: Pose, isForeseen: boolean): number | undefined {
    const dealt = this.#following.isAway ? undefined : this.#dealing.deal();
    this.#owed = dealt === undefined ? { pose, isForeseen } : undefined;
    if (dealt === undefined) {
      return undefined;
    }
    const { culler, frame } = dealt;
    this.#frame = frame;
    this.counts.cameras += 1;
    this.#asked.set(frame, { at: performance.now(), isForeseen });
    this.#links[culler]?.latest.publish({ ...pose, frame, viewState: this.#view.version });
    return frame;
  }

  /** Changes the view state, from the next published camera on. */
  change(change: Partial<ViewState>): void {
    this.#view = { version: this.#view.version + 1, state: { ...this.#view.state, ...change } };
    for (const message of viewMessages(this.#view.version, this.#view.state)) {
      for (const link of this.#links) {
        link.messages.send(message);
      }
    }
  }

  /**
   * By this number others on the service may follow this display. Nothing if its frames come from several
   * cullers, or from another display.
   */
  get leaderKey(): bigint | undefined {
    return this.#links.length === 1 && !this.#following.isAway ? this.#leaderKey : undefined;
  }

  /** The display that this one follows. */
  get leader(): bigint | undefined {
    return this.#following.leader;
  }

  /**
   * Shows the sets of another display of the service, with its cameras and view states, in place of its own.
   * Without a number it goes on by itself. A display with several cullers follows nobody.
   */
  follow(leader: bigint | undefined): void {
    const message = this.#links.length === 1 ? this.#following.follow(leader) : undefined;
    if (message !== undefined) {
      this.#tell(message);
    }
  }

  /** The renderer has lost all geometry: it is requested again with the next published camera. */
  loseGeometry(): void {
    const gone = this.holdings.loseAll();
    this.#waiting.length = 0;
    this.#say(dropped(gone));
  }

  leave(): void {
    for (const link of this.#links) {
      link.close(CloseCode.finished, "");
    }
  }

  /** A link is over. The others go with it. */
  #end(end: LinkEnd): void {
    const isFirst = !this.isOver;
    this.isOver = true;
    this.#introduction?.stop();
    this.leave();
    if (isFirst) {
      this.#onEnd(end);
    }
  }

  /** Ends the link with an error if the culler breaks the protocol. */
  #guard(take: () => void): void {
    try {
      take();
    } catch (error) {
      if (!(error instanceof WireError)) {
        throw error;
      }
      for (const link of this.#links) {
        link.close(CloseCode.failed, error.message);
      }
    }
  }

  #tell(message: RoleMessage): void {
    this.#links[0]?.messages.send(message);
  }

  /** Lets others follow. */
  #lead(): void {
    if (this.#links.length === 1) {
      this.#tell({ what: "lead", leader: this.#leaderKey });
    }
  }

  #takeFrame(culler: number, frame: Frame<Camera, Uint32Array>): void {
    const fault = faultOfIds(frame.items, this.outline.drawables);
    if (fault !== undefined) {
      throw new WireError(fault);
    }
    if (culler === 0) {
      this.#takeSorted(frame);
    } else if (!this.#following.isAway) {
      this.#takeOwn(culler, frame);
    }
  }

  /** Takes the first culler's frames, as far as it is known whose they are. */
  #takeSorted(frame?: Frame<Camera, Uint32Array>): void {
    for (const { frame: sorted, led } of this.#following.sort(frame)) {
      const isLed = led !== undefined;
      if (isLed !== this.#isLed) {
        // The numbers of frames are others.
        this.#isLed = isLed;
        this.#newestFound = 0;
        this.#waiting.length = 0;
      }
      if (isLed) {
        this.#takeLed(sorted, led);
      } else {
        this.#takeOwn(0, sorted);
      }
    }
  }

  #takeLed({ header: camera, items: ids }: Frame<Camera, Uint32Array>, led: ViewState): void {
    this.counts.ids += ids.length;
    this.#wait({ camera, posed: performance.now(), isForeseen: false, led, ids });
  }

  #takeOwn(culler: number, { header: camera, items: ids }: Frame<Camera, Uint32Array>): void {
    this.#dealing.came(culler, camera.frame);
    this.#publishOwed();
    if (camera.frame < this.#newestFound) {
      // Another culler was faster with a newer one.
      return;
    }
    this.#newestFound = camera.frame;
    const now = performance.now();
    const { at: posed, isForeseen } = this.#asked.get(camera.frame) ?? { at: now, isForeseen: false };
    this.latency = now - posed;
    [this.interval, this.#came] = [now - Math.max(this.#came, posed), now];
    this.counts.ids += ids.length;
    this.timeline.came(camera.frame, posed, now);
    for (const number of this.#asked.keys()) {
      if (number <= camera.frame) {
        this.#asked.delete(number);
      }
    }
    this.#wait({ camera, posed, isForeseen, led: undefined, ids });
  }

  /** Shows a set once it can be shown. */
  #wait(set: Omit<FoundSet, "lacking">): void {
    const lacking = this.holdings.lacking(set.ids);
    if (lacking.length > 0) {
      this.#say(lacks(set.camera.frame, this.#taken, lacking.slice().sort()));
    }
    this.#waiting.push({ ...set, lacking });
    if (this.#waiting.length > WAITING) {
      this.#waiting.splice(WAITING / 2, 1);
    }
    this.#look();
  }

  #takeMessage(culler: number, message: RoleMessage): void {
    if (message.what === "stats") {
      this.timeline.said(message.stats);
    } else if (culler === 0 && this.#following.hear(message)) {
      if (message.what === "unfollowed") {
        // Following ended its own lead.
        this.#lead();
      }
      this.#takeSorted();
      this.#publishOwed();
    } else {
      this.#introduction?.hear(culler, message);
    }
  }

  #takeBlock(block: Uint8Array): void {
    this.holdings.take(block);
    this.#taken += block.length;
    this.#say([]);
    this.#look();
  }

  /** Takes what comes over the links, until they end. */
  #listen(): void {
    const each = async <T>(arrivals: AsyncIterable<T>, take: (arrival: T) => void) => {
      try {
        for await (const arrival of arrivals) {
          this.#guard(() => take(arrival));
        }
      } catch (error) {
        // A link's end is told by `closed` as well.
        if (!(error instanceof LinkError)) {
          throw error;
        }
      }
    };
    for (const [culler, link] of this.#links.entries()) {
      each(link.frames, (frame) => this.#takeFrame(culler, frame));
      each(link.messages, (message) => this.#takeMessage(culler, message));
      each(link.bulk, (block) => this.#takeBlock(block));
      link.closed.then((end) => this.#end(end));
    }
  }

  /** Connects two cullers to each other, to take turns from then on. Until then each culls independently. */
  #introduce(meeting: string): Introduction {
    return new Introduction(
      meeting,
      (culler, message) => this.#links[culler]?.messages.send(message),
      () => {
        this.#dealing.isHeld = true;
        return this.#dealing.last + 1;
      },
      ({ isSwitched }) => {
        [this.#dealing.isHeld, this.#dealing.isInTurn] = [false, isSwitched];
        this.#publishOwed();
      },
    );
  }

  #publishOwed(): void {
    if (this.#owed !== undefined) {
      this.publish(this.#owed.pose, this.#owed.isForeseen);
    }
  }

  /**
   * Shows the newest set. If some of it has not even a stand-in, the newest whole set before it is shown as
   * well.
   */
  #look(): void {
    let newest: { set: FoundSet; ids: readonly number[] | Uint32Array; isExact: boolean } | undefined;
    for (let at = this.#waiting.length - 1; at >= 0; at -= 1) {
      const set = this.#waiting[at];
      if (set === undefined) {
        continue;
      }
      const wasLacking = set.lacking.length > 0;
      set.lacking = this.holdings.lacking(set.lacking);
      const isExact = set.lacking.length === 0;
      if (wasLacking && isExact) {
        this.geometryLatency = performance.now() - set.posed;
      }
      const { shown, isWhole } = isExact
        ? { shown: set.ids, isWhole: true }
        : this.holdings.standingIn(set.ids);
      newest ??= { set, ids: shown, isExact };
      if (isWhole) {
        this.#whole = shown;
        // A set that is not complete yet is shown again.
        this.#waiting.splice(0, isExact ? at + 1 : at);
        break;
      }
    }
    if (newest !== undefined && this.#whole !== undefined) {
      const { set, ids, isExact } = newest;
      this.#show(set, ids === this.#whole ? ids : new Set([...ids, ...this.#whole]), isExact);
    }
  }

  #show({ camera, posed, isForeseen, led }: FoundSet, ids: Iterable<number>, isExact: boolean): void {
    const found: DrawableRecord[] = [];
    for (const id of ids) {
      const record = this.holdings.record(id);
      if (record !== undefined) {
        found.push(record);
      }
    }
    this.#recent.add({ posed, drawables: found });
    const drawables = isForeseen ? this.#recent.union() : found;
    this.shown = { camera, posed, drawables, found, isExact, led };
    const gone = this.holdings.use(drawables);
    if (gone.length > 0) {
      for (const set of this.#waiting) {
        set.lacking = this.holdings.lacking(set.ids);
      }
      this.#say(dropped(gone));
    }
    if (isExact && led === undefined) {
      this.#say([{ item: "shown", frame: camera.frame }]);
    }
  }

  /** Sends all pending items together. */
  #say(items: readonly DisplayItem[]): void {
    if (!this.#isDue) {
      this.#isDue = true;
      queueMicrotask(() => {
        const due = this.#due;
        if (this.#taken !== this.#confirmed) {
          this.#confirmed = this.#taken;
          due.push({ item: "taken", bytes: this.#taken });
        }
        this.#due = [];
        this.#isDue = false;
        const [supplier] = this.#links;
        if (supplier !== undefined && !this.isOver) {
          for (const block of packBlocks(due)) {
            supplier.bulk.send(block);
          }
        }
      });
    }
    for (const item of items) {
      this.#due.push(item);
    }
  }
}

/** Opens this many links, one after the other. If one fails, all are closed. */
async function connectAll(count: number, connect: () => Promise<CullerLink>): Promise<CullerLink[]> {
  const links: CullerLink[] = [];
  try {
    while (links.length < count) {
      links.push(await connect());
    }
    if (links.some(({ isOver }) => isOver)) {
      throw new WireError("a culler has left while others were looked for");
    }
    return links;
  } catch (error) {
    for (const link of links) {
      link.close(CloseCode.finished, "");
    }
    throw error;
  }
}
