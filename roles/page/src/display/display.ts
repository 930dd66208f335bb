/**
 * The display's part of a session: cameras go to a culler, and what is visible comes back, with the geometry
 * that is not here yet. Whatever is there is drawn at any time, from the newest pose.
 */

import { type Camera, decodeCamera, encodeCamera } from "../proto/camera.ts";
import { faultOfIds, IdDecoder } from "../proto/idCoding.ts";
import { CloseCode, decodeIdentity, encodeIdentity, type Outline, TRIMARAN } from "../proto/identity.ts";
import { decodeRoleMessage, viewMessages } from "../proto/messages.ts";
import { loadCodecs } from "../proto/piece.ts";
import type { DrawableRecord } from "../proto/records.ts";
import type { Settings } from "../proto/settings.ts";
import { type DisplayItem, dropped, holds, lacks, packBlocks } from "../proto/supply.ts";
import { type ViewState, viewStateOf } from "../proto/viewState.ts";
import { WireError } from "../wire/bytes.ts";
import type { Frame } from "../wire/frames.ts";
import { connect, type Link, type LinkEnd } from "../wire/link.ts";
import { Holdings, type Store } from "./holdings.ts";
import { RecentSets } from "./recentSets.ts";
import { Timeline } from "./timeline.ts";

/** How many bytes may come that no frame needs yet. */
const AHEAD = 256 << 10;
/** How many frames wait for their geometry: the first ones and the newest. */
const WAITING = 8;

export interface DisplayOptions {
  readonly settings: Settings;
  /** The most bytes of unpacked geometry that are kept. */
  readonly memory: number;
  readonly store: Store;
  readonly onEnd: (end: LinkEnd) => void;
}

/** A set of drawables that a culler has found for a camera. */
interface FoundSet {
  readonly camera: Camera;
  /** When the camera was published. */
  readonly posed: number;
  readonly isForeseen: boolean;
  readonly ids: Uint32Array;
  lacking: Uint32Array;
}

/** What is to be drawn. */
export interface Shown {
  /** The camera for which it was found. */
  readonly camera: Camera;
  readonly drawables: readonly DrawableRecord[];
  /** The part of it that was found for this camera. */
  readonly found: readonly DrawableRecord[];
  /** When that was published, by `performance.now()`. */
  readonly posed: number;
  /** Nothing stands in for anything. */
  readonly isExact: boolean;
}

export class Display {
  readonly #link: Link;
  readonly #holdings: Holdings;
  readonly #waiting: FoundSet[] = [];
  /** Frames that were published, by number: when, and whether nobody has been there yet. */
  readonly #asked = new Map<number, { readonly at: number; readonly isForeseen: boolean }>();
  #shown: Shown | undefined;
  /** The newest set that was all there, or that something stood in for. */
  #whole: readonly number[] | Uint32Array | undefined;
  readonly #recent = new RecentSets();
  #due: DisplayItem[] = [];
  #isDue = false;
  /** Bytes of blocks that were taken, and what the culler knows of that. */
  #taken = 0;
  #confirmed = 0;
  #frame = 0;
  #view: { version: number; state: ViewState };
  #latency = 0;
  /** When the newest set came, and how long it took once the one before was there. */
  #came = 0;
  #interval = 0;
  #geometryLatency = 0;
  readonly timeline = new Timeline();
  /** Cameras that were published, and ids that came. */
  readonly counts = { cameras: 0, ids: 0 };

  private constructor(link: Link, holdings: Holdings, settings: Settings) {
    [this.#link, this.#holdings] = [link, holdings];
    this.#view = { version: 0, state: viewStateOf(settings) };
    this.#say([...holds(...holdings.all()), { item: "begin", coarserFirst: true, ahead: AHEAD }]);
  }

  /**
   * Finds a culler at `url`, and begins a session with it. Of the same scene it keeps what the display
   * `before` had, and shows that until something newer is there.
   */
  static async join(url: string, options: DisplayOptions, before?: Display): Promise<Display> {
    await loadCodecs();
    const { settings } = options;
    const key = crypto.getRandomValues(new BigUint64Array(1))[0] ?? 0n;
    let outline: Outline | undefined;
    let display: Display | undefined;
    const link = await connect(url, encodeIdentity({ role: "display", session: { key, settings } }), {
      application: TRIMARAN,
      admit: (introduction) => {
        const { role, scene } = decodeIdentity(introduction);
        if (role !== "culler" || scene === undefined) {
          return { isTaken: false, why: "a display needs a culler with a scene" };
        }
        outline = scene;
        return { isTaken: true, mostIds: scene.drawables, decoder: new IdDecoder() };
      },
      handlers: {
        onFrame: (frame) => display?.guard(() => display?.takeFrame(frame)),
        onMessage: (payload) => display?.guard(() => display?.takeMessage(payload)),
        onBlock: (block) => display?.guard(() => display?.takeBlock(block)),
        onEnd: options.onEnd,
      },
    });
    if (outline === undefined) {
      throw new WireError("the culler did not say which scene it has");
    }
    const kept = before?.outline.hash === outline.hash ? before : undefined;
    const holdings = kept?.holdings ?? new Holdings(outline, options.store, options.memory);
    holdings.beginAnew();
    display = new Display(link, holdings, settings);
    if (kept !== undefined) {
      // Its frames are not taken for those of this link.
      display.#frame = kept.#frame + 1;
      [display.#shown, display.#whole] = [kept.#shown, kept.#whole];
    }
    return display;
  }

  get outline(): Outline {
    return this.#holdings.outline;
  }

  get holdings(): Holdings {
    return this.#holdings;
  }

  get link(): Link {
    return this.#link;
  }

  /** Milliseconds from a camera to its set, of the newest set that came. */
  get latency(): number {
    return this.#latency;
  }

  /** Milliseconds that the newest set took once the one before was there: a busy culler takes so long. */
  get interval(): number {
    return this.#interval;
  }

  /** Milliseconds from a camera until all is there that its set lacked, of the newest that lacked some. */
  get geometryLatency(): number {
    return this.#geometryLatency;
  }

  /** Whether what is shown was found for the newest camera, and is all there. */
  get isSettled(): boolean {
    return this.#shown?.isExact === true && this.#shown.camera.frame === this.#frame;
  }

  /** What is to be drawn now; nothing before the first set is there. */
  get shown(): Shown | undefined {
    return this.#shown;
  }

  /**
   * Asks what is visible from here. A pose that was not culled yet gives way to it. Where the eye is not, but
   * may soon be, what was visible lately is shown as well. Gives the number of the frame.
   */
  publish(pose: Omit<Camera, "frame" | "viewState">, isForeseen: boolean): number {
    this.#frame += 1;
    this.counts.cameras += 1;
    this.#asked.set(this.#frame, { at: performance.now(), isForeseen });
    this.#link.publish(encodeCamera({ ...pose, frame: this.#frame, viewState: this.#view.version }));
    return this.#frame;
  }

  /** Changes what is seen; the next camera that is published is seen in it. */
  change(change: Partial<ViewState>): void {
    this.#view = { version: this.#view.version + 1, state: { ...this.#view.state, ...change } };
    for (const message of viewMessages(this.#view.version, this.#view.state)) {
      this.#link.sendMessage(message);
    }
  }

  /** Whoever draws has lost all geometry: it comes again. The next camera that is published asks for it. */
  loseGeometry(): void {
    const gone = this.#holdings.loseAll();
    this.#waiting.length = 0;
    this.#say(dropped(gone));
  }

  leave(): void {
    this.#link.close(CloseCode.finished, "");
  }

  /** Ends the link where the culler has broken the protocol, and says why. */
  guard(take: () => void): void {
    try {
      take();
    } catch (error) {
      if (!(error instanceof WireError)) {
        throw error;
      }
      this.#link.close(CloseCode.failed, error.message);
    }
  }

  takeFrame(frame: Frame): void {
    const fault = faultOfIds(frame.ids, this.outline.drawables);
    if (fault !== undefined) {
      throw new WireError(fault);
    }
    const camera = decodeCamera(frame.header);
    const now = performance.now();
    const { at: posed, isForeseen } = this.#asked.get(camera.frame) ?? { at: now, isForeseen: false };
    this.#latency = now - posed;
    [this.#interval, this.#came] = [now - Math.max(this.#came, posed), now];
    this.counts.ids += frame.ids.length;
    this.timeline.came(camera.frame, posed, now);
    for (const number of this.#asked.keys()) {
      if (number <= camera.frame) {
        this.#asked.delete(number);
      }
    }
    const lacking = this.#holdings.lacking(frame.ids);
    if (lacking.length > 0) {
      this.#say(lacks(camera.frame, this.#taken, lacking.slice().sort()));
    }
    this.#waiting.push({ camera, posed, isForeseen, ids: frame.ids, lacking });
    if (this.#waiting.length > WAITING) {
      this.#waiting.splice(WAITING / 2, 1);
    }
    this.#look();
  }

  takeMessage(payload: Uint8Array): void {
    const message = decodeRoleMessage(payload);
    if (message.what === "stats") {
      this.timeline.said(message.stats);
    }
  }

  takeBlock(block: Uint8Array): void {
    this.#holdings.take(block);
    this.#taken += block.length;
    this.#say([]);
    this.#look();
  }

  /**
   * Shows the newest set. Where not even something stands in for what it lacks, the newest one before it that
   * is whole is shown as well.
   */
  #look(): void {
    let newest: { set: FoundSet; ids: readonly number[] | Uint32Array; isExact: boolean } | undefined;
    for (let at = this.#waiting.length - 1; at >= 0; at -= 1) {
      const set = this.#waiting[at];
      if (set === undefined) {
        continue;
      }
      const wasLacking = set.lacking.length > 0;
      set.lacking = this.#holdings.lacking(set.lacking);
      const isExact = set.lacking.length === 0;
      if (wasLacking && isExact) {
        this.#geometryLatency = performance.now() - set.posed;
      }
      const { shown, isWhole } = isExact
        ? { shown: set.ids, isWhole: true }
        : this.#holdings.standingIn(set.ids);
      newest ??= { set, ids: shown, isExact };
      if (isWhole) {
        this.#whole = shown;
        // A set that is not all there yet is shown again.
        this.#waiting.splice(0, isExact ? at + 1 : at);
        break;
      }
    }
    if (newest !== undefined && this.#whole !== undefined) {
      const { set, ids, isExact } = newest;
      this.#show(set, ids === this.#whole ? ids : new Set([...ids, ...this.#whole]), isExact);
    }
  }

  #show({ camera, posed, isForeseen }: FoundSet, ids: Iterable<number>, isExact: boolean): void {
    const found: DrawableRecord[] = [];
    for (const id of ids) {
      const record = this.#holdings.record(id);
      if (record !== undefined) {
        found.push(record);
      }
    }
    this.#recent.add({ posed, drawables: found });
    const drawables = isForeseen ? this.#recent.union() : found;
    this.#shown = { camera, posed, drawables, found, isExact };
    const gone = this.#holdings.use(drawables);
    if (gone.length > 0) {
      for (const set of this.#waiting) {
        set.lacking = this.#holdings.lacking(set.ids);
      }
      this.#say(dropped(gone));
    }
    if (isExact) {
      this.#say([{ item: "shown", frame: camera.frame }]);
    }
  }

  /** All that is to be said at once goes together. */
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
        if (!this.#link.isOver) {
          for (const block of packBlocks(due)) {
            this.#link.sendBlock(block);
          }
        }
      });
    }
    this.#due.push(...items);
  }
}
