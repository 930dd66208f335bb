/** Encodes ids as changes, as its page describes: the counterpart of the page's decoder. */

import { Writer } from "trimaran-transport";

/** Ascending `ids` as runs over `held`, the ids of a frame `back` before; with 0 over nothing. */
export function encodeIds(
  ids: readonly number[],
  back: number,
  held: readonly number[],
): Uint8Array<ArrayBuffer> {
  const writer = new Writer().varint(back);
  let place = back === 0 ? 0 : firstAtLeast(held, ids[0] ?? 0);
  if (back !== 0) {
    writer.varint(place);
  }
  let least = place === 0 ? 0 : (held[place - 1] ?? 0) + 1;
  const reference = back === 0 ? [] : held;
  for (let at = 0; at < ids.length; ) {
    let kept = 0;
    while (at + kept < ids.length && ids[at + kept] === reference[place + kept]) {
      kept += 1;
    }
    at += kept;
    place += kept;
    least = kept === 0 ? least : (ids[at - 1] ?? 0) + 1;
    const next = ids[at];
    const skipped = next === undefined ? 0 : firstAtLeast(reference, next) - place;
    if (next === undefined || skipped > 0) {
      writeRun(writer, kept, skipped, 0, 2);
      place += skipped;
      least = skipped === 0 ? least : Math.max(least, (reference[place - 1] ?? 0) + 1);
    } else {
      const stop = reference[place] ?? Number.POSITIVE_INFINITY;
      const put = ids.slice(at).filter((id) => id < stop);
      writeRun(writer, kept, put.length, 1, 3);
      for (const id of put) {
        writer.varint(id - least);
        least = id + 1;
      }
      at += put.length;
    }
  }
  return writer.take();
}

function writeRun(writer: Writer, kept: number, count: number, one: number, many: number): void {
  writer.varint(4 * kept + (count === 1 ? one : many));
  if (count !== 1) {
    writer.varint(count);
  }
}

function firstAtLeast(numbers: readonly number[], least: number): number {
  const at = numbers.findIndex((number) => number >= least);
  return at === -1 ? numbers.length : at;
}
