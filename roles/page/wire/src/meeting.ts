/** The handshake of a link's lanes and channels: each sends a hello, and waits for an answer. */

import { WireError } from "./bytes.ts";
import { errorOfEnd, LinkError } from "./errors.ts";
import {
  type ChannelFormat,
  decodeAccept,
  decodeRefuse,
  decodeVersionedAccept,
  describeRefusal,
  encodeChannelsHello,
  encodeHello,
  type Hello,
  LANES,
  type LaneId,
  type LaneName,
  titleOf,
} from "./handshake.ts";
import { type Connection, IDLE_TIMEOUT, Lane, type LaneOptions } from "./lane.ts";
import { type Format, Kind, type Message, nameOfKind } from "./messages.ts";
import { onlyVersion, SUPPORTED, versionInCommon } from "./versions.ts";
import { Waiter, type Waiting } from "./waiter.ts";

export type Lanes = Readonly<Record<LaneName, Lane>>;

/** A hello but for what each lane says alike or by itself. */
type Opening = Omit<Hello, "lane" | "idleTimeout"> & { readonly channels: readonly ChannelFormat[] };
type Introduction = Omit<Opening, "versions">;

/** The sizes of a protocol's data, and those of its channels. */
export interface Formats {
  readonly lanes: Format;
  readonly channels: readonly Format[];
}

/** The lanes of a link, and the listener's introduction. */
export interface Meeting {
  readonly lanes: Lanes;
  readonly channels: readonly Lane[];
  readonly listener: Uint8Array;
}

/**
 * Opens the lanes and channels and sends hellos. If one fails, all are closed and a `LinkError` is thrown; if
 * it is aborted, the signal's reason.
 *
 * Messages after a lane's answer wait there.
 */
export async function meet(
  open: (lane: LaneId) => Promise<Connection>,
  hello: Introduction,
  formats: Formats,
  options: Omit<LaneOptions, "format"> & Waiting,
): Promise<Meeting> {
  const meetAs = (versions: Hello["versions"]) => meetOnce(open, { ...hello, versions }, formats, options);
  try {
    return await meetAs(SUPPORTED);
  } catch (error) {
    const refusal = error instanceof LinkError ? error.refusal : undefined;
    const earlier = refusal?.reason === "versions" ? versionInCommon(SUPPORTED, refusal.listener) : undefined;
    if (earlier === undefined) {
      throw error;
    }
    // A listener of version 4 refuses a hello with a range.
    return meetAs(onlyVersion(earlier));
  }
}

async function meetOnce(
  open: (lane: LaneId) => Promise<Connection>,
  hello: Opening,
  formats: Formats,
  options: Omit<LaneOptions, "format"> & Waiting,
): Promise<Meeting> {
  const opened: Lane[] = [];
  let isGivenUp = false;
  const greetOn = async (id: LaneId, title: string, format: Format) => {
    const connection = await open(id);
    if (isGivenUp) {
      connection.close();
      throw new LinkError("unreachable", "another lane failed");
    }
    const lane = new Lane(title, connection, { ...options, format });
    opened.push(lane);
    return greet(lane, id, hello);
  };
  try {
    const answers = Promise.all([
      ...LANES.map((name) => greetOn(name, titleOf(name), formats.lanes)),
      ...formats.channels.map((format, at) => greetOn(at, `channel ${hello.channels[at]?.name}`, format)),
    ]);
    const [latest, frames, messages, bulk, ...channels] = (await inTime(answers, options)) as AllMet;
    const { listener } = latest;
    if (![frames, messages, bulk, ...channels].every((other) => sameBytes(other.listener, listener))) {
      const text = "the lanes were answered by listeners that call themselves differently";
      throw new LinkError("violation", text);
    }
    const lanes = { latest: latest.lane, frames: frames.lane, messages: messages.lane, bulk: bulk.lane };
    return { lanes, channels: channels.map(({ lane }) => lane), listener };
  } catch (error) {
    isGivenUp = true;
    for (const lane of opened) {
      lane.leave();
    }
    if (error instanceof LinkError || options.signal?.aborted === true) {
      throw error;
    }
    throw new LinkError("unreachable", error instanceof Error ? error.message : String(error), {
      cause: error,
    });
  }
}

interface Met {
  readonly lane: Lane;
  readonly listener: Uint8Array;
}

type AllMet = [Met, Met, Met, Met, ...Met[]];

/** Sends a hello on a lane and waits for the answer. */
function greet(lane: Lane, id: LaneId, { channels, ...hello }: Opening): Promise<Met> {
  return new Promise((resolve, reject) => {
    lane.onEnd = (end) => reject(errorOfEnd(end));
    lane.listen(({ kind, payload }: Message) => {
      if (kind === Kind.accept || kind === Kind.versionedAccept) {
        lane.listen(undefined);
        const decode = kind === Kind.accept ? decodeAccept : decodeVersionedAccept;
        const { idleTimeout, introduction } = decode(payload);
        lane.agree(idleTimeout);
        resolve({ lane, listener: introduction });
      } else if (kind === Kind.refuse) {
        const refusal = decodeRefuse(payload);
        lane.leave();
        reject(new LinkError("refused", describeRefusal(refusal), { refusal }));
      } else {
        throw new WireError(`a ${nameOfKind(kind)} came instead of an answer to hello`);
      }
    });
    const opening = { ...hello, lane: id, idleTimeout: IDLE_TIMEOUT };
    if (channels.length === 0) {
      lane.send(Kind.hello, encodeHello(opening));
    } else {
      lane.send(Kind.channelsHello, encodeChannelsHello({ ...opening, channels }));
    }
  });
}

/** The answers, unless they exceed the idle timeout or are aborted. */
async function inTime<T>(
  answers: Promise<T>,
  { clock, signal }: Pick<LaneOptions, "clock"> & Waiting,
): Promise<T> {
  const giveUp = new Waiter<T>(new Set(), { signal });
  const late = () => giveUp.reject(new LinkError("timeout", "the listener did not answer in time"));
  const callOff = clock.after(IDLE_TIMEOUT, late);
  answers.then(giveUp.resolve, giveUp.reject);
  return giveUp.promise.finally(callOff);
}

function sameBytes(a: Uint8Array, b: Uint8Array): boolean {
  return a.length === b.length && a.every((byte, at) => byte === b[at]);
}
