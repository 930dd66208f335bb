/** Links to programs that use the Rust crate trimaran-transport, over WebSockets. */

export { Reader, randomNumber, shownText, WireError, Writer } from "./bytes.ts";
export type { Channel, ChannelLanes, Channels, FrameChannel, NoChannels, ValueChannel } from "./channels.ts";
export {
  bool,
  bytes,
  type Codec,
  checked,
  count,
  type Fields,
  f32,
  f64,
  i8,
  i16,
  i32,
  i64,
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
  u128,
  variant,
  whole,
} from "./codec.ts";
export { type ConnectOptions, connect } from "./connect.ts";
export { type LinkEnd, LinkError, type LinkErrorCode } from "./errors.ts";
export {
  array,
  type FieldType,
  type Fixed,
  fixed,
  type Layout,
  type NumberType,
  nothing,
  number,
  struct,
  type ValueOf,
} from "./fixed.ts";
export type { NewFrame } from "./frameSender.ts";
export type { BatchDecoder, Frame } from "./frames.ts";
export { type Close, type LaneId, type LaneName, perLane, type Refusal } from "./handshake.ts";
export type { Receiver } from "./inbox.ts";
export { type Items, itemsOf, typedItems } from "./items.ts";
export type { Clock, Connection } from "./lane.ts";
export type { FramesLane, LatestLane, MessagesLane } from "./lanes.ts";
export type { Bytes, Link, LinkOf } from "./link.ts";
export { MOST_BLOCK, MOST_ITEMS, MOST_MESSAGE } from "./messages.ts";
export { defineProtocol, type Protocol } from "./protocol.ts";
export { LOWEST_WIRE_VERSION, type Versions, WIRE_VERSION } from "./versions.ts";
export type { Waiting } from "./waiter.ts";
export type { Socket } from "./websocket.ts";
