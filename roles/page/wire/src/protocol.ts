/** Protocols: what two peers must agree on before they can have a link. */

import { type Channels, checkChannels, type NoChannels } from "./channels.ts";
import type { Codec } from "./codec.ts";
import { type Fixed, nothing } from "./fixed.ts";
import type { BatchDecoder } from "./frames.ts";
import { type Items, typedItems } from "./items.ts";
import type { Format } from "./messages.ts";

/** A protocol, as the trait `Protocol` of the Rust crate. `defineProtocol` makes one. */
export interface Protocol<Hello, Latest, Header, ItemArray, Message, C extends Channels = NoChannels> {
  /** Its name with its version, such as `robot/1`: at most 32 bytes. Peers of other names get no link. */
  readonly name: string;
  /** How a peer introduces itself: at most 200 bytes. */
  readonly hello: Codec<Hello>;
  /** The value of the latest lane: at most 1,024 bytes. */
  readonly latest: Fixed<Latest>;
  /** The header of a frame: at most 1,024 bytes. */
  readonly header: Fixed<Header>;
  /** The items of a frame: 1 to 256 bytes each. */
  readonly items: Items<ItemArray>;
  /** A message: at most 16,384 bytes. */
  readonly message: Codec<Message>;
  /** Further lanes by name, at most 16. Peers with others, or in another order, get no link. */
  readonly channels: C;
  /** Makes a link's decoder of coded batches. Without it, no batch may be coded. */
  readonly decoder?: () => BatchDecoder<ItemArray>;
}

/** A protocol of any types. */
export type AnyProtocol = Protocol<unknown, unknown, unknown, unknown, unknown, Channels>;

/** A protocol without the lanes that it does not need. */
type Definition<P> = Omit<P, "latest" | "header" | "items" | "message" | "channels"> & Partial<P>;

/**
 * Defines a protocol. A lane that is left out has values without content, as Rust's `()`, and items of `u32`.
 * Without `channels` there are none.
 *
 * Throws a `RangeError` for sizes and names that the wire does not allow.
 */
export function defineProtocol<
  Hello,
  Latest = undefined,
  Header = undefined,
  ItemArray = Uint32Array<ArrayBuffer>,
  Message = undefined,
  C extends Channels = NoChannels,
>(
  definition: Definition<Protocol<Hello, Latest, Header, ItemArray, Message, C>>,
): Protocol<Hello, Latest, Header, ItemArray, Message, C> {
  const items = typedItems(Uint32Array);
  const left = { latest: nothing, header: nothing, items, message: nothing, channels: {} };
  const protocol = { ...left, ...definition } as Protocol<Hello, Latest, Header, ItemArray, Message, C>;
  checkProtocol(protocol);
  return protocol;
}

function checkProtocol({ name, latest, header, items, channels }: AnyProtocol): void {
  within(`the name ${name}`, new TextEncoder().encode(name).length, 1, 32);
  within("a latest value", latest.size, 0, 1024);
  within("a header", header.size, 0, 1024);
  within("an item", items.size, 1, 256);
  checkChannels(channels, within);
}

function within(what: string, bytes: number, least: number, most: number): void {
  if (!(bytes >= least && bytes <= most)) {
    throw new RangeError(`${what} has ${bytes} bytes: it must have ${least} to ${most}`);
  }
}

/** The sizes of a protocol's data. */
export function formatOf({ latest, header, items }: AnyProtocol): Format {
  return { latest: latest.size, header: header.size, item: items.size };
}
