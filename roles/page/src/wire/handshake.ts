/** The handshake and the end of a link: hello, accept, refuse and close. */

import { cutText, Reader, shownText, WireError, Writer } from "./bytes.ts";

/** The version of the wire of links. Peers of different versions refuse each other. */
export const WIRE_VERSION = 3;

/** The close code of a connecting peer that rejects the listener. */
export const CODE_NOT_TAKEN = 65_535;

/** The lanes of a link, in the order of their numbers. */
export const LANES = ["latest", "frames", "messages", "bulk"] as const;

export type LaneName = (typeof LANES)[number];

/** The first message of each connection. */
export interface Hello {
  /** The name of the application's protocol, with its version. */
  readonly application: string;
  /** The random number that the four connections of a link share. */
  readonly session: bigint;
  readonly lane: LaneName;
  /** The application's own hello. */
  readonly introduction: Uint8Array;
}

/** Why a hello was refused, with both sides' values. */
export type Refusal =
  | { readonly reason: "versions"; readonly listener: number; readonly connector: number }
  | { readonly reason: "applications"; readonly listener: string; readonly connector: string }
  | { readonly reason: "not taken"; readonly code: number; readonly text: string }
  | { readonly reason: "lane"; readonly session: bigint; readonly lane: LaneName }
  | { readonly reason: "unpaired"; readonly session: bigint }
  | { readonly reason: "busy" }
  | { readonly reason: "key"; readonly claimed: string; readonly known: string };

/** A close: a number for programs, a text for people. */
export interface Close {
  readonly code: number;
  readonly text: string;
}

/** The payload of a hello. */
export function encodeHello({ application, session, lane, introduction }: Hello): Uint8Array<ArrayBuffer> {
  const writer = new Writer().bytes(MAGIC).u16(WIRE_VERSION).text(application).varint(session);
  return writer.variant(LANES, lane).bytes(introduction).take();
}

/** Reads the payload of a hello. Of another version only the version is read. */
export function decodeHello(payload: Uint8Array): Hello {
  const reader = new Reader(payload);
  if (!reader.bytes(MAGIC.length).every((byte, at) => byte === MAGIC[at])) {
    throw new WireError("the hello does not start with the magic number: this is not a Trimaran peer");
  }
  const version = reader.u16();
  if (version !== WIRE_VERSION) {
    throw new WireError(`the peer speaks version ${version} of the wire, this one version ${WIRE_VERSION}`);
  }
  const application = reader.text(MOST_NAME);
  const session = reader.varint64();
  return { application, session, lane: reader.variant(LANES), introduction: reader.rest() };
}

/** The payload of a refuse of this version. */
export function encodeRefuse(refusal: Refusal): Uint8Array<ArrayBuffer> {
  const writer = new Writer().u16(WIRE_VERSION).variant(REASONS, refusal.reason);
  switch (refusal.reason) {
    case "versions":
      writer.varint(refusal.listener).varint(refusal.connector);
      break;
    case "applications":
      writer.text(refusal.listener).text(refusal.connector);
      break;
    case "not taken":
      writer.varint(refusal.code).text(cutText(refusal.text, MOST_REJECTION));
      break;
    case "lane":
      writer.varint(refusal.session).variant(LANES, refusal.lane);
      break;
    case "unpaired":
      writer.varint(refusal.session);
      break;
    case "busy":
      break;
    case "key":
      writer.text(cutText(refusal.claimed, MOST_TEXT)).text(cutText(refusal.known, MOST_TEXT));
      break;
  }
  return writer.take();
}

/** Reads the payload of a refuse. If the versions differ, that is the reason, and nothing else is read. */
export function decodeRefuse(payload: Uint8Array): Refusal {
  const reader = new Reader(payload);
  const listener = reader.u16();
  if (listener !== WIRE_VERSION) {
    return { reason: "versions", listener, connector: WIRE_VERSION };
  }
  const refusal = readReason(reader);
  reader.end();
  return refusal;
}

/** Why a peer was refused, for people. */
export function describeRefusal(refusal: Refusal): string {
  const release = "install the same release on both";
  switch (refusal.reason) {
    case "versions":
      return `the listener speaks version ${refusal.listener} of the wire, this page version \
${refusal.connector}: ${release}`;
    case "applications":
      return `the listener speaks ${shownText(refusal.listener)}, this page \
${shownText(refusal.connector)}: ${release}`;
    case "not taken":
      return shownText(refusal.text);
    case "lane":
      return `the ${refusal.lane} lane came twice or from a peer that calls itself something else`;
    case "unpaired":
      return "another lane of the link did not come in time";
    case "busy":
      return "the listener has too many peers or handshakes under way: try again";
    case "key":
      return `this page claims to be ${shownText(refusal.claimed)}, and the listener knows its key as \
that of ${shownText(refusal.known)}`;
  }
}

/** Whether the same peer may be admitted on another try. */
export function mayTryAgain(refusal: Refusal): boolean {
  return refusal.reason === "busy" || refusal.reason === "unpaired";
}

/** The payload of a close. At most 200 bytes of the text are sent. */
export function encodeClose({ code, text }: Close): Uint8Array<ArrayBuffer> {
  return new Writer().varint(code).text(cutText(text, MOST_TEXT)).take();
}

/** Reads the payload of a close. */
export function decodeClose(payload: Uint8Array): Close {
  const reader = new Reader(payload);
  const close = { code: reader.varint16(), text: reader.text(MOST_TEXT) };
  reader.end();
  return close;
}

function readReason(reader: Reader): Refusal {
  const reason = reader.variant(REASONS);
  switch (reason) {
    case "versions":
      return { reason, listener: reader.varint16(), connector: reader.varint16() };
    case "applications":
      return { reason, listener: reader.text(MOST_NAME), connector: reader.text(MOST_NAME) };
    case "not taken":
      return { reason, code: reader.varint16(), text: reader.text(MOST_REJECTION) };
    case "lane":
      return { reason, session: reader.varint64(), lane: reader.variant(LANES) };
    case "unpaired":
      return { reason, session: reader.varint64() };
    case "busy":
      return { reason };
    case "key":
      return { reason, claimed: reader.text(MOST_TEXT), known: reader.text(MOST_TEXT) };
  }
}

/** `TRIM`. */
const MAGIC = new Uint8Array([0x54, 0x52, 0x49, 0x4d]);

/** The most bytes of an application's name. */
const MOST_NAME = 32;

/** The most bytes of a text for people. */
const MOST_TEXT = 200;

/** The most bytes of the text with which an application refuses a peer. */
const MOST_REJECTION = 400;

/** The reasons, in the order of their numbers. */
const REASONS = ["versions", "applications", "not taken", "lane", "unpaired", "busy", "key"] as const;
