/** Makes a link to a listener. */

import { randomNumber, WireError } from "./bytes.ts";
import { type Channels, channelFormat, describeChannels, type NoChannels } from "./channels.ts";
import { type Codec, whole } from "./codec.ts";
import { LinkError } from "./errors.ts";
import { loadHashers } from "./frames.ts";
import { CODE_NOT_TAKEN, type LaneId } from "./handshake.ts";
import { type Clock, type Connection, systemClock } from "./lane.ts";
import { Link } from "./link.ts";
import { meet } from "./meeting.ts";
import { MOST_INTRODUCTION } from "./messages.ts";
import { formatOf, type Protocol } from "./protocol.ts";
import type { Waiting } from "./waiter.ts";
import { openWebSocket, type Socket } from "./websocket.ts";

/** How to connect. */
export interface ConnectOptions<Hello> extends Waiting {
  /** This side's introduction. */
  readonly hello: Hello;
  /** Ends the attempt: `AbortSignal.timeout(5000)` gives it five seconds. The link lives on without it. */
  readonly signal?: AbortSignal | undefined;
  /** Judges the listener: returns why this side does not take it, if so. The listener is told. */
  readonly admit?: (theirs: Hello) => string | undefined;
  /** How many items a frame may have. A peer that sends more breaks the protocol. By default 4,194,304. */
  readonly maxItems?: number | ((theirs: Hello) => number);
  /** Keeps only this many unread frames, the newest. By default all are kept, up to `maxUnread`. */
  readonly keepFrames?: number;
  /** How many bytes may wait for a reader on a lane, before the link ends. By default 64 MiB. */
  readonly maxUnread?: number;
  /** Makes a WebSocket, where there is none built in. */
  readonly webSocket?: (url: string) => Socket;
  /** Opens the connection of a lane, or of the channel of this number, other than by a WebSocket. */
  readonly open?: (url: string, lane: LaneId) => Promise<Connection>;
  /** The clock that all timeouts read. */
  readonly clock?: Clock;
  /** The number that pairs the connections, instead of a random one. */
  readonly session?: bigint;
}

/**
 * Connects once to the listener at `url`, such as `ws://robot.local:7400/`, and introduces this side to it.
 *
 * Throws a `LinkError` if there is no link, and the signal's reason if that is aborted. Errors of the options'
 * own functions are thrown as they are.
 */
export async function connect<Hello, Value, Header, Items, Message, C extends Channels = NoChannels>(
  url: string,
  protocol: Protocol<Hello, Value, Header, Items, Message, C>,
  options: ConnectOptions<Hello>,
): Promise<Link<Hello, Value, Header, Items, Message, C>> {
  const { clock = systemClock, signal, keepFrames: keep, maxUnread = 1 << 26, webSocket } = options;
  const open = options.open ?? ((url: string) => openWebSocket(url, webSocket));
  const introduction = whole(protocol.hello).encode(options.hello);
  if (introduction.length > MOST_INTRODUCTION) {
    throw new RangeError(`a hello of ${introduction.length} bytes: it has at most ${MOST_INTRODUCTION}`);
  }
  const session = options.session ?? randomNumber();
  const channels = describeChannels(protocol.channels);
  const hello = { application: protocol.name, session, introduction, channels };
  signal?.throwIfAborted();
  // Of the frames lane, and of each channel.
  const hashers = await Promise.all([0, ...channels].map(loadHashers));
  const formats = {
    lanes: formatOf(protocol),
    channels: Object.values(protocol.channels).map(channelFormat),
  };
  const { listener, ...met } = await meet((lane) => open(url, lane), hello, formats, { clock, signal });
  try {
    const peer = judge(listener, protocol.hello, options);
    const { maxItems = 1 << 22 } = options;
    const rule = { keep, maxUnread, maxItems: typeof maxItems === "number" ? maxItems : maxItems(peer) };
    return new Link({ protocol, peer, ...met, clock, hashers, rule });
  } catch (error) {
    const text = error instanceof LinkError ? error.message : "it failed while it made the link";
    for (const lane of [...Object.values(met.lanes), ...met.channels]) {
      lane.leave({ code: CODE_NOT_TAKEN, text });
    }
    throw error;
  }
}

/** The listener's hello. Throws a `LinkError` if this side does not take it. */
function judge<Hello>(listener: Uint8Array, hello: Codec<Hello>, { admit }: ConnectOptions<Hello>): Hello {
  let peer: Hello;
  try {
    peer = whole(hello).decode(listener);
  } catch (error) {
    if (error instanceof WireError) {
      const text = `the listener's hello cannot be read: ${error.message}`;
      throw new LinkError("violation", text, { cause: error });
    }
    throw error;
  }
  const why = admit?.(peer);
  if (why !== undefined) {
    throw new LinkError("rejected", why);
  }
  return peer;
}
