/** The handshake and the end of a link: hello, accept, refuse and close. */

import { Reader, shownText, WireError, Writer } from "./bytes.ts";
import {
  type Codec,
  checked,
  list,
  type Of,
  option,
  record,
  rest,
  tagged,
  text,
  u8,
  u16,
  u32,
  u64,
  variant,
  whole,
} from "./codec.ts";
import {
  CHOSEN,
  LOWEST_WIRE_VERSION,
  OFFERED,
  onlyVersion,
  SUPPORTED,
  shownVersions,
  VERSIONS,
  versionInCommon,
} from "./versions.ts";

/** The close code of a connecting peer that rejects the listener. */
export const CODE_NOT_TAKEN = 65_535;

/** The lanes of a link, in the order of their numbers. */
export const LANES = ["latest", "frames", "messages", "bulk"] as const;

export type LaneName = (typeof LANES)[number];

/** A lane, or the number of a channel. */
export type LaneId = LaneName | number;

/** A value for each lane. */
export function perLane<T>(of: (lane: LaneName) => T): Readonly<Record<LaneName, T>> {
  return { latest: of("latest"), frames: of("frames"), messages: of("messages"), bulk: of("bulk") };
}

/** `TRIM`. */
const MAGIC = new Uint8Array([0x54, 0x52, 0x49, 0x4d]);

/** The application's name. */
const NAME = text(32);
/** A text for people. */
const TEXT = text(200);
const LANE_OR_CHANNEL = variant([...LANES, "channel"]);
const LANE: Codec<LaneId> = {
  read(reader) {
    const lane = LANE_OR_CHANNEL.read(reader);
    return lane === "channel" ? reader.u8() : lane;
  },
  write(writer, lane) {
    LANE_OR_CHANNEL.write(writer, typeof lane === "number" ? "channel" : lane);
    if (typeof lane === "number") {
      writer.u8(lane);
    }
  },
};

const CHANNEL = record({
  name: NAME,
  sizes: tagged("kind", { latest: { value: u16 }, frames: { header: u16, item: u16 } }),
});

/** A channel of a peer: its name, and the sizes of its data. */
export type ChannelFormat = Of<typeof CHANNEL>;

/** The first message of each connection begins so, behind the magic number. */
const OPENING = {
  /** The versions of the wire that the connecting peer speaks. */
  versions: OFFERED,
  /** The name of the application's protocol, with its version. */
  application: NAME,
  /** The random number that the connections of a link share. */
  session: u64,
  lane: LANE,
  /** After so much silence the peer counts as lost, milliseconds. */
  idleTimeout: u32,
};

/** The hello of a protocol without channels. It ends with the application's own. */
const HELLO = record({ ...OPENING, introduction: rest });

export type Hello = Of<typeof HELLO>;

const CHANNELS_HELLO = record({
  ...OPENING,
  channels: checked(list(CHANNEL, 16, "channels"), ({ length }) => (length > 0 ? undefined : "no channels")),
  introduction: rest,
});

export type ChannelsHello = Of<typeof CHANNELS_HELLO>;

const ANSWER = {
  /** As in the hello. The shorter one holds for both sides. */
  idleTimeout: u32,
  /** The listener's own hello. */
  introduction: rest,
};

/** The answer to a hello of version 4. */
export const { encode: encodeAccept, decode: decodeAccept } = whole(record(ANSWER));

/** The answer to a hello, with the version of the link. */
export const { encode: encodeVersionedAccept, decode: decodeVersionedAccept } = whole(
  record({ version: CHOSEN, ...ANSWER }),
);

/** Why a hello was refused, with both sides' values; in the order of their numbers. */
const REFUSAL = tagged("reason", {
  versions: { listener: VERSIONS, connector: VERSIONS },
  applications: { listener: NAME, connector: NAME },
  "not taken": { code: u16, text: text(400) },
  lane: { session: u64, lane: LANE },
  unpaired: { session: u64 },
  busy: {},
  key: { claimed: TEXT, known: TEXT },
  channels: { number: u8, listener: option(CHANNEL), connector: option(CHANNEL) },
});

export type Refusal = Of<typeof REFUSAL>;

/** A close: a number for programs, a text for people, of which at most 200 bytes are sent. */
const CLOSE = record({ code: u16, text: TEXT });

export type Close = Of<typeof CLOSE>;

export const { encode: encodeClose, decode: decodeClose } = whole(CLOSE);

/** The payload of a hello. */
export const encodeHello = (hello: Hello) => encodeOpening(HELLO, hello);
export const encodeChannelsHello = (hello: ChannelsHello) => encodeOpening(CHANNELS_HELLO, hello);

/** Reads the payload of a hello. Of other versions only these are read. */
export const decodeHello = (payload: Uint8Array) => decodeOpening(HELLO, payload);
export const decodeChannelsHello = (payload: Uint8Array) => decodeOpening(CHANNELS_HELLO, payload);

function encodeOpening<T>(codec: Codec<T>, hello: T): Uint8Array<ArrayBuffer> {
  const writer = new Writer().bytes(MAGIC);
  codec.write(writer, hello);
  return writer.take();
}

function decodeOpening<T>(codec: Codec<T>, payload: Uint8Array): T {
  const reader = new Reader(payload);
  if (!reader.bytes(MAGIC.length).every((byte, at) => byte === MAGIC[at])) {
    throw new WireError("the hello does not start with the magic number: this is not a Trimaran peer");
  }
  return codec.read(reader);
}

/** The payload of a refuse. It has the layout of the listener's lowest version. */
export function encodeRefuse(refusal: Refusal): Uint8Array<ArrayBuffer> {
  const writer = new Writer().u16(LOWEST_WIRE_VERSION);
  REFUSAL.write(writer, refusal);
  return writer.take();
}

/** Reads the payload of a refuse. Of another layout only the versions are read. */
export function decodeRefuse(payload: Uint8Array): Refusal {
  const reader = new Reader(payload);
  const layout = onlyVersion(reader.u16());
  const isKnown = versionInCommon(SUPPORTED, layout) !== undefined;
  try {
    const refusal = REFUSAL.read(reader);
    reader.end();
    if (isKnown || refusal.reason === "versions") {
      return refusal;
    }
  } catch (error) {
    // Version 4 names one version of each side.
    if (!(error instanceof WireError) || (isKnown && payload[2] !== 0)) {
      throw error;
    }
  }
  return { reason: "versions", listener: layout, connector: SUPPORTED };
}

/** Why a peer was refused, for people. */
export function describeRefusal(refusal: Refusal): string {
  const release = "install the same release on both";
  switch (refusal.reason) {
    case "versions":
      return `the listener speaks ${shownVersions(refusal.listener)} of the wire, this side \
${shownVersions(refusal.connector)}: ${release}`;
    case "applications":
      return `the listener speaks ${shownText(refusal.listener)}, this side \
${shownText(refusal.connector)}: ${release}`;
    case "not taken":
      return shownText(refusal.text);
    case "lane":
      return `the ${titleOf(refusal.lane)} came twice or from a peer that calls itself something else`;
    case "unpaired":
      return "another lane of the link did not come in time";
    case "busy":
      return "the listener has too many peers or handshakes under way: try again";
    case "key":
      return `this side claims to be ${shownText(refusal.claimed)}, and the listener knows its key as \
that of ${shownText(refusal.known)}`;
    case "channels":
      return `channel ${refusal.number} of the listener is ${shownChannel(refusal.listener)}, that of this \
side ${shownChannel(refusal.connector)}: ${release}`;
  }
}

/** A lane or channel in texts for people: `frames lane`. */
export function titleOf(lane: LaneId): string {
  return typeof lane === "number" ? `channel ${lane}` : `${lane} lane`;
}

function shownChannel(channel: ChannelFormat | undefined): string {
  if (channel === undefined) {
    return "missing";
  }
  const { sizes } = channel;
  const name = `\`${shownText(channel.name)}\``;
  return sizes.kind === "latest"
    ? `${name} of values of ${sizes.value} bytes`
    : `${name} of frames with headers of ${sizes.header} and items of ${sizes.item} bytes`;
}
