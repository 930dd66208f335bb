/** The identity of a peer: the application's hello. And its close codes. */

import { Reader, Writer } from "../wire/bytes.ts";
import type { Application } from "../wire/link.ts";
import { readSettings, type Settings, writeSettings } from "./settings.ts";

/** The protocol that peers of Trimaran's links must agree on. */
export const TRIMARAN: Application = {
  name: "trimaran/2",
  format: { latest: 72, header: 72, item: 4 },
};

/** The roles of peers in a session. */
export const ROLES = ["culler", "display"] as const;

export type Role = (typeof ROLES)[number];

/** The scene, and how many records of each kind it has. */
export interface Outline {
  /** The scene's fingerprint. */
  readonly hash: bigint;
  readonly nodes: number;
  /** The most ids that a frame can have. */
  readonly drawables: number;
  /** Pieces of geometry. */
  readonly geometries: number;
  readonly objects: number;
}

/** The session that a link is for. */
export interface Session {
  /** A random number of the display. */
  readonly key: bigint;
  readonly settings: Settings;
}

export interface Identity {
  readonly role: Role;
  /** The cooked scene that it holds. A display may hold none. */
  readonly scene?: Outline | undefined;
  /** None for a culler that serves any display. */
  readonly session?: Session | undefined;
}

/** Why a listener's application rejects a peer. */
export const RejectionCode = { scene: 1, role: 3 } as const;

/** Why a peer closes a link. */
export const CloseCode = { finished: 0, interrupted: 1, failed: 2, deviceFailed: 4, replaced: 5 } as const;

export function encodeIdentity({ role, scene, session }: Identity): Uint8Array<ArrayBuffer> {
  const writer = new Writer().variant(ROLES, role);
  writer.option(scene, ({ hash, nodes, drawables, geometries, objects }) => {
    writer.varint(hash).varint(nodes).varint(drawables).varint(geometries).varint(objects);
  });
  writer.option(session, ({ key, settings }) => {
    writeSettings(writer.varint(key), settings);
  });
  return writer.take();
}

export function decodeIdentity(bytes: Uint8Array): Identity {
  const reader = new Reader(bytes);
  const role = reader.variant(ROLES);
  const scene = reader.option(() => readOutline(reader));
  const session = reader.option(() => ({ key: reader.varint64(), settings: readSettings(reader) }));
  reader.end();
  return { role, scene, session };
}

function readOutline(reader: Reader): Outline {
  return {
    hash: reader.varint128(),
    nodes: reader.varint32(),
    drawables: reader.varint32(),
    geometries: reader.varint32(),
    objects: reader.varint32(),
  };
}
