/** Colours that lie over those of the model. They are shading alone: culling knows nothing of them. */

import type { ObjectSet } from "../proto/objectSet.ts";

/** A colour of a screen: 8 bits each of red, green and blue, red the highest. */
export type Rgb = number;

/** Objects in a colour. */
export interface Paint {
  readonly label: string;
  readonly colour: Rgb;
  readonly objects: ObjectSet;
}

/** All colours over the model. */
export interface Colouring {
  /** The attribute whose values the colours show; empty for colours by hand. */
  readonly by: string;
  /** Later ones lie over earlier ones. At most `MOST_PAINTS`. */
  readonly paints: readonly Paint[];
}

/** Room for a scale of numbers, and for colours by hand. */
export const MOST_PAINTS = 64;

export const NO_COLOURS: Colouring = { by: "", paints: [] };

/** Of objects without a colour, where colours show an attribute. */
export const REST: Rgb = 0xdddddd;

/** Marks a colour among other bits. */
const PAINTED = 1 << 24;

/** Finds the colour of an object. */
export class ObjectColours {
  /** Where runs of objects of one colour begin, ascending; the last one has no end. */
  readonly #starts: Uint32Array;
  readonly #codes: Uint32Array;

  constructor({ by, paints }: Colouring) {
    const rest = by === "" ? 0 : PAINTED | REST;
    const events = eventsOf(paints);
    const starts = new Uint32Array(events.length + 1);
    const codes = new Uint32Array(events.length + 1);
    /** Whether each paint covers the present object. */
    const covers = new Uint8Array(paints.length);
    codes[0] = rest;
    let count = 1;
    for (let next = 0; next < events.length; ) {
      const at = placeOf(events[next]);
      for (; next < events.length && placeOf(events[next]) === at; next += 1) {
        const [paint, isStart] = changeOf(events[next]);
        covers[paint] = isStart ? 1 : 0;
      }
      const last = covers.lastIndexOf(1);
      const code = last < 0 ? rest : PAINTED | (paints[last]?.colour ?? 0);
      count -= starts[count - 1] === at ? 1 : 0;
      [starts[count], codes[count]] = [at, code];
      count += 1;
    }
    [this.#starts, this.#codes] = [starts.slice(0, count), codes.slice(0, count)];
  }

  /** The colour of an object, with bit 24 set; 0 if it has that of the model. */
  codeOf(object: number): number {
    let [low, high] = [0, this.#starts.length];
    while (high - low > 1) {
      const middle = (low + high) >>> 1;
      if ((this.#starts[middle] ?? 0) <= object) {
        low = middle;
      } else {
        high = middle;
      }
    }
    return this.#codes[low] ?? 0;
  }
}

/** The starts and ends of all runs in one order: numbers that sort by the place, then by the paint. */
function eventsOf(paints: readonly Paint[]): Float64Array {
  const runs = paints.reduce((sum, { objects }) => sum + objects.runs.length, 0);
  const events = new Float64Array(2 * runs);
  let count = 0;
  for (const [paint, { objects }] of paints.entries()) {
    for (const { first, end } of objects.runs) {
      events[count] = first * 2 * MOST_PAINTS + 2 * paint + 1;
      events[count + 1] = end * 2 * MOST_PAINTS + 2 * paint;
      count += 2;
    }
  }
  return events.sort();
}

function placeOf(event = 0): number {
  return Math.floor(event / (2 * MOST_PAINTS));
}

function changeOf(event = 0): readonly [paint: number, isStart: boolean] {
  const rest = event % (2 * MOST_PAINTS);
  return [rest >>> 1, rest % 2 === 1];
}

/** An entry of the legend: paints of one label, one behind the other. */
export interface LegendEntry {
  readonly label: string;
  readonly colours: readonly Rgb[];
  readonly objects: ObjectSet;
}

/** The legend of colours, with an entry for each label. */
export function legendOf({ paints }: Colouring): readonly LegendEntry[] {
  const entries: LegendEntry[] = [];
  for (const { label, colour, objects } of paints) {
    const last = entries.at(-1);
    if (last?.label === label) {
      const merged = { label, colours: [...last.colours, colour], objects: last.objects.union(objects) };
      entries[entries.length - 1] = merged;
    } else {
      entries.push({ label, colours: [colour], objects });
    }
  }
  return entries;
}
