/** The handshake of a link's four lanes: each sends a hello, and waits for an answer. */

import { WireError } from "./bytes.ts";
import { errorOfEnd, LinkError } from "./errors.ts";
import {
  decodeAccept,
  decodeRefuse,
  describeRefusal,
  encodeHello,
  type Hello,
  LANES,
  type LaneName,
} from "./handshake.ts";
import { type Channel, IDLE_TIMEOUT, Lane, type LaneOptions } from "./lane.ts";
import { Kind, type Message, nameOfKind } from "./messages.ts";
import { Waiter, type Waiting } from "./waiter.ts";

export type Lanes = Readonly<Record<LaneName, Lane>>;

/** A hello but for what each lane says alike or by itself. */
type Introduction = Omit<Hello, "lane" | "idleTimeout">;

/** The lanes of a link, and the listener's introduction. */
export interface Meeting {
  readonly lanes: Lanes;
  readonly listener: Uint8Array;
}

/**
 * Opens four lanes and sends hellos. If one fails, all are closed and a `LinkError` is thrown; if it
 * is aborted, the signal's reason.
 *
 * Messages after a lane's answer wait there.
 */
export async function meet(
  open: (lane: LaneName) => Promise<Channel>,
  hello: Introduction,
  options: LaneOptions & Waiting,
): Promise<Meeting> {
  const opened: Lane[] = [];
  let isGivenUp = false;
  const greetOn = async (name: LaneName) => {
    const channel = await open(name);
    if (isGivenUp) {
      channel.close();
      throw new LinkError("unreachable", "another lane failed");
    }
    const lane = new Lane(name, channel, options);
    opened.push(lane);
    return greet(lane, hello);
  };
  try {
    const answers = Promise.all(LANES.map(greetOn));
    const [latest, frames, messages, bulk] = (await inTime(answers, options)) as [Met, Met, Met, Met];
    const { listener } = latest;
    if (![frames, messages, bulk].every((other) => sameBytes(other.listener, listener))) {
      const text = "the lanes were answered by listeners that call themselves differently";
      throw new LinkError("violation", text);
    }
    const lanes = { latest: latest.lane, frames: frames.lane, messages: messages.lane, bulk: bulk.lane };
    return { lanes, listener };
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

/** Sends a hello on a lane and waits for the answer. */
function greet(lane: Lane, hello: Introduction): Promise<Met> {
  return new Promise((resolve, reject) => {
    lane.onEnd = (end) => reject(errorOfEnd(end));
    lane.listen(({ kind, payload }: Message) => {
      if (kind === Kind.accept) {
        lane.listen(undefined);
        const { idleTimeout, introduction } = decodeAccept(payload);
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
    lane.send(Kind.hello, encodeHello({ ...hello, lane: lane.name, idleTimeout: IDLE_TIMEOUT }));
  });
}

/** The answers, unless they exceed the idle timeout or are aborted. */
async function inTime<T>(answers: Promise<T>, { clock, signal }: LaneOptions & Waiting): Promise<T> {
  const giveUp = new Waiter<T>(new Set(), { signal });
  const late = () => giveUp.reject(new LinkError("timeout", "the listener did not answer in time"));
  const callOff = clock.after(IDLE_TIMEOUT, late);
  answers.then(giveUp.resolve, giveUp.reject);
  return giveUp.promise.finally(callOff);
}

function sameBytes(a: Uint8Array, b: Uint8Array): boolean {
  return a.length === b.length && a.every((byte, at) => byte === b[at]);
}
