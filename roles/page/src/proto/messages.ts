/** Messages between roles on the messages lane. */

import { Reader, Writer } from "../wire/bytes.ts";
import { readStats, type Stats, writeStats } from "./stats.ts";
import { type ViewPart, type ViewState, viewParts } from "./viewState.ts";

export type RoleMessage =
  | { readonly what: "stats"; readonly stats: Stats }
  | { readonly what: "meet"; readonly key: bigint; readonly endpoint: string | undefined }
  | { readonly what: "met"; readonly key: bigint }
  | { readonly what: "unmet"; readonly key: bigint }
  | { readonly what: "switch"; readonly key: bigint; readonly firstFrame: number }
  | { readonly what: "switched"; readonly key: bigint }
  | { readonly what: "part" }
  | ({ readonly what: "view" } & ViewPart)
  | { readonly what: "waits"; readonly key: bigint };

export function encodeRoleMessage(message: RoleMessage): Uint8Array<ArrayBuffer> {
  const writer = new Writer().variant(WHAT, message.what);
  switch (message.what) {
    case "stats":
      writeStats(writer, message.stats);
      break;
    case "meet":
      writer.varint(message.key).option(message.endpoint, (endpoint) => writer.text(endpoint));
      break;
    case "met":
    case "unmet":
    case "switched":
    case "waits":
      writer.varint(message.key);
      break;
    case "switch":
      writer.varint(message.key).varint(message.firstFrame);
      break;
    case "part":
      break;
    case "view":
      writer.varint(message.version).byteString(message.part).bool(message.isLast);
      break;
  }
  return writer.take();
}

export function decodeRoleMessage(payload: Uint8Array): RoleMessage {
  const reader = new Reader(payload);
  const message = readMessage(reader);
  reader.end();
  return message;
}

/** The messages that tell a culler of a view state, in order. */
export function viewMessages(version: number, state: ViewState): Uint8Array<ArrayBuffer>[] {
  return viewParts(version, state).map((part) => encodeRoleMessage({ what: "view", ...part }));
}

function readMessage(reader: Reader): RoleMessage {
  const what = reader.variant(WHAT);
  switch (what) {
    case "stats":
      return { what, stats: readStats(reader) };
    case "meet":
      return { what, key: reader.varint64(), endpoint: reader.option(() => reader.text()) };
    case "met":
    case "unmet":
    case "switched":
    case "waits":
      return { what, key: reader.varint64() };
    case "switch":
      return { what, key: reader.varint64(), firstFrame: reader.varint32() };
    case "part":
      return { what };
    case "view":
      return { what, version: reader.varint32(), part: reader.byteString(), isLast: reader.bool() };
  }
}

/** The kinds of messages, in the order of their numbers. */
const WHAT = ["stats", "meet", "met", "unmet", "switch", "switched", "part", "view", "waits"] as const;
