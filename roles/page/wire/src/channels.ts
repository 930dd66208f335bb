/** Channels: further lanes of a link, each with a name and types of its own. */

import type { Fixed } from "./fixed.ts";
import type { BatchDecoder } from "./frames.ts";
import type { ChannelFormat } from "./handshake.ts";
import type { Items } from "./items.ts";
import type { FramesLane, LatestLane } from "./lanes.ts";
import type { Format } from "./messages.ts";

/** A channel of values: only the newest counts. */
export interface ValueChannel<Value> {
  /** A value: at most 1,024 bytes. */
  readonly latest: Fixed<Value>;
}

/** A channel of frames. */
export interface FrameChannel<Header, ItemArray> {
  /** The header of a frame: at most 1,024 bytes. */
  readonly header: Fixed<Header>;
  /** The items of a frame: 1 to 256 bytes each. */
  readonly items: Items<ItemArray>;
  /** Makes a link's decoder of coded batches. Without it, no batch may be coded. */
  readonly decoder?: () => BatchDecoder<ItemArray>;
}

/** A channel of either kind. */
export type Channel = ValueChannel<unknown> | FrameChannel<unknown, unknown>;

/** Channels by name, in their order. */
export type Channels = Readonly<Record<string, Channel>>;

/** A protocol without channels. */
export type NoChannels = Readonly<Record<never, never>>;

/** The lanes of a link's channels, by name. */
export type ChannelLanes<C> = {
  readonly [Name in keyof C]: C[Name] extends ValueChannel<infer Value>
    ? LatestLane<Value>
    : C[Name] extends FrameChannel<infer Header, infer ItemArray>
      ? FramesLane<Header, ItemArray>
      : never;
};

/** The most channels of a protocol. */
const MOST_CHANNELS = 16;

/** Throws a `RangeError` for channels that the wire does not allow. */
export function checkChannels(
  channels: Channels,
  within: (what: string, bytes: number, least: number, most: number) => void,
): void {
  const names = Object.keys(channels);
  if (names.length > MOST_CHANNELS) {
    throw new RangeError(`the protocol has ${names.length} channels: it may have ${MOST_CHANNELS}`);
  }
  for (const [name, channel] of Object.entries(channels)) {
    within(`the name of the channel ${name}`, new TextEncoder().encode(name).length, 1, 32);
    if (/^\d+$/.test(name)) {
      throw new RangeError(`a channel is called ${name}: an object does not keep the order of such names`);
    }
    const { latest, header, item } = channelFormat(channel);
    within(`a value of the channel ${name}`, latest, 0, 1024);
    within(`a header of the channel ${name}`, header, 0, 1024);
    within(`an item of the channel ${name}`, item, "items" in channel ? 1 : 0, 256);
  }
}

/** The sizes of a channel's data. */
export function channelFormat(channel: Channel): Format {
  return "latest" in channel
    ? { latest: channel.latest.size, header: 0, item: 0 }
    : { latest: 0, header: channel.header.size, item: channel.items.size };
}

/** The channels as a hello has them. */
export function describeChannels(channels: Channels): readonly ChannelFormat[] {
  return Object.entries(channels).map(([name, channel]) => {
    const { latest, header, item } = channelFormat(channel);
    const sizes =
      "latest" in channel
        ? ({ kind: "latest", value: latest } as const)
        : ({ kind: "frames", header, item } as const);
    return { name, sizes };
  });
}
