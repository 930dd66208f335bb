/** Versions of the wire, and the one that two peers have in common. */

import { WireError } from "./bytes.ts";
import { type Codec, type Of, record, u16 } from "./codec.ts";

/** The highest version of the wire of links that this package speaks. */
export const WIRE_VERSION = 5;

/** The lowest one: that of the release before. */
export const LOWEST_WIRE_VERSION = 4;

/** The last version without ranges: its hello names this version alone, and its accept names none. */
export const WITHOUT_RANGE = 4;

/** As a refusal names them. */
export const VERSIONS = record({ highest: u16, lowest: u16 });

/** The versions of the wire that a peer speaks: all from the lowest to the highest. */
export type Versions = Of<typeof VERSIONS>;

/** Those that this package speaks. */
export const SUPPORTED: Versions = { highest: WIRE_VERSION, lowest: LOWEST_WIRE_VERSION };

export const onlyVersion = (version: number): Versions => ({ highest: version, lowest: version });

/** The highest version that both peers speak, if there is one. */
export function versionInCommon(ours: Versions, theirs: Versions): number | undefined {
  const highest = Math.min(ours.highest, theirs.highest);
  return highest >= Math.max(ours.lowest, theirs.lowest) ? highest : undefined;
}

/** As a hello names them: each has two bytes, and version 4 names no lowest one. */
export const OFFERED: Codec<Versions> = {
  read(reader) {
    const highest = reader.u16();
    const theirs = { highest, lowest: highest > WITHOUT_RANGE ? reader.u16() : highest };
    // The rest has the layout of the lowest one, or of version 5 if that is higher.
    if (versionInCommon(SUPPORTED, theirs) === undefined) {
      throw new WireError(
        `the peer speaks ${shownVersions(theirs)} of the wire, this one ${shownVersions(SUPPORTED)}`,
      );
    }
    return theirs;
  },
  write(writer, { highest, lowest }) {
    writer.u16(highest);
    if (highest > WITHOUT_RANGE) {
      writer.u16(lowest);
    }
  },
};

/** As an accept names the version of the link. */
export const CHOSEN: Codec<number> = {
  read(reader) {
    const version = reader.u16();
    if (version <= WITHOUT_RANGE || version > WIRE_VERSION) {
      throw new WireError(`the listener chose version ${version} of the wire, which was not offered`);
    }
    return version;
  },
  write: (writer, version) => writer.u16(version),
};

export function shownVersions({ highest, lowest }: Versions): string {
  return highest === lowest ? `version ${highest}` : `versions ${lowest} to ${highest}`;
}
