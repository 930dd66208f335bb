/** Reads coordinates as people type and paste them. */

import { LETTERS } from "../space/plantFrame.ts";
import { type Axis, type Point, pointOf } from "../space/point.ts";
import type { Unit } from "./lengths.ts";

/** Why a text is not read as coordinates, in a sentence. */
export class CoordinatesError extends Error {}

export const EXAMPLE = "E 1234.5 N 678.9 U 10";

/** The longest text. */
const LONGEST = 200;
/** Coordinates beyond this are a mistake, metres. */
const FARTHEST = 1e12;

/** A coordinate by the word before or behind its number; `sign` is -1 for the opposite direction. */
interface Direction {
  readonly axis: Axis;
  readonly sign: 1 | -1;
}

/** The words of each direction. W, S and D are those of AVEVA's programs. */
const WORDS: readonly (readonly [axis: Axis, sign: 1 | -1, words: string])[] = [
  [0, 1, "e east easting x"],
  [0, -1, "w west"],
  [1, 1, "n north northing y"],
  [1, -1, "s south"],
  [2, 1, "u up z h height el elev elevation"],
  [2, -1, "d down"],
];
const DIRECTIONS = new Map<string, Direction>(
  WORDS.flatMap(([axis, sign, words]) => words.split(" ").map((word) => [word, { axis, sign }] as const)),
);
const FOOT = 0.3048;
const INCH = 0.0254;
/** Metres of each unit, by its words. */
const UNIT_WORDS: readonly (readonly [metres: number, words: string])[] = [
  [1, "m metre metres meter meters"],
  [0.01, "cm"],
  [0.001, "mm"],
  [FOOT, "ft foot feet ' ′ ’"],
  [INCH, 'in inch inches " ″ ”'],
];
const UNITS = new Map<string, number>(
  UNIT_WORDS.flatMap(([metres, words]) => words.split(" ").map((word) => [word, metres] as const)),
);
/** Metres of a number without a unit. */
const BARE: Readonly<Record<Unit, number>> = { m: 1, mm: 0.001, "ft-in": FOOT };

interface Token {
  readonly kind: "number" | "word" | "end";
  readonly text: string;
}

/** A number, with the words that belong to it. */
interface Quantity {
  readonly text: string;
  value: number;
  unit?: number;
  direction?: Direction;
  /** Inches may follow: it is in feet, and nothing is between. */
  isOpen: boolean;
}

/**
 * The east, north and up of a text, metres. Numbers without a unit are in `unit`; a lone unit at the end
 * is that of all. Throws a `CoordinatesError`.
 */
export function coordinatesOf(text: string, unit: Unit): Point {
  if (text.trim() === "") {
    throw new CoordinatesError(`Type coordinates, such as ${EXAMPLE}.`);
  }
  if (text.length > LONGEST) {
    throw new CoordinatesError(`That is too long: at most ${LONGEST} letters.`);
  }
  const quantities = quantitiesOf(tokensOf(text));
  const metres = metresOf(quantities, BARE[unit]);
  const far = metres.findIndex((value) => !(Math.abs(value) <= FARTHEST));
  if (far >= 0) {
    throw new CoordinatesError(`${quantities[far]?.text} is too far away.`);
  }
  return inOrder(quantities, metres);
}

/** The words and numbers of a text. */
function tokensOf(text: string): readonly Token[] {
  const withCommas = split(text, /[+\-−]?(?:\d+(?:[.,]\d+)*\.?|\.\d+)/y);
  // A comma between digits may also stand between numbers: then there are three only by that.
  const isPlain = !/[\p{L};\t\n]/u.test(text);
  const count = (tokens: readonly Token[]) => tokens.filter(({ kind }) => kind === "number").length;
  if (isPlain && count(withCommas) !== 3) {
    const apart = split(text, /[+\-−]?(?:\d+(?:\.\d+)?\.?|\.\d+)/y);
    return count(apart) === 3 ? apart : withCommas;
  }
  return withCommas;
}

function split(text: string, number: RegExp): readonly Token[] {
  const tokens: Token[] = [];
  const [word, between] = [/\p{L}+|['′’"″”]/uy, /[\s,;:=|()[\]]+/uy];
  for (let at = 0; at < text.length; ) {
    const take = (pattern: RegExp) => {
      pattern.lastIndex = at;
      return pattern.exec(text)?.[0];
    };
    const [skipped, numeral, letters] = [take(between), take(number), take(word)];
    const taken = skipped ?? numeral ?? letters;
    if (taken === undefined) {
      throw new CoordinatesError(`“${[...text.slice(at)][0]}” is not understood.`);
    }
    if (skipped !== undefined) {
      if (/[,;\t\n]/.test(skipped)) {
        tokens.push({ kind: "end", text: skipped });
      }
    } else {
      tokens.push({ kind: numeral === undefined ? "word" : "number", text: taken });
    }
    at += taken.length;
  }
  return tokens;
}

/** The numbers, each with its unit and its direction. */
function quantitiesOf(tokens: readonly Token[]): readonly Quantity[] {
  const quantities: Quantity[] = [];
  const first = tokens.find(({ kind }) => kind !== "end");
  const isBefore = first?.kind === "word";
  let next: { direction: Direction; text: string } | undefined;
  for (const { kind, text } of tokens) {
    const last = quantities.at(-1);
    if (kind === "end") {
      if (last !== undefined) {
        last.isOpen = false;
      }
    } else if (kind === "number") {
      const quantity: Quantity = { text, value: numberOf(text), isOpen: false };
      if (next !== undefined) {
        quantity.direction = next.direction;
      }
      quantities.push(quantity);
      next = undefined;
    } else {
      const [unit, direction] = [UNITS.get(text.toLowerCase()), DIRECTIONS.get(text.toLowerCase())];
      if (unit !== undefined) {
        setUnit(quantities, unit, text);
      } else if (direction === undefined) {
        throw new CoordinatesError(`“${text}” is neither a direction nor a unit.`);
      } else if (isBefore) {
        if (next !== undefined) {
          throw new CoordinatesError(`${next.text} has no number.`);
        }
        next = { direction, text };
      } else if (last === undefined || last.direction !== undefined) {
        throw new CoordinatesError(`${text} has no number.`);
      } else {
        last.direction = direction;
      }
    }
  }
  if (next !== undefined) {
    throw new CoordinatesError(`${next.text} has no number.`);
  }
  return quantities;
}

/** Gives the last number a unit. Inches right behind feet are added to them. */
function setUnit(quantities: Quantity[], unit: number, text: string): void {
  const [last, before] = [quantities.at(-1), quantities.at(-2)];
  if (last === undefined || last.unit !== undefined) {
    throw new CoordinatesError(`“${text}” stands behind no number.`);
  }
  if (unit === INCH && before?.isOpen === true && last.direction === undefined) {
    const isNegative = before.value < 0 || before.text.startsWith("-");
    before.value += ((isNegative ? -1 : 1) * last.value * INCH) / FOOT;
    before.isOpen = false;
    quantities.pop();
    return;
  }
  last.unit = unit;
  last.isOpen = unit === FOOT;
}

/** The numbers in metres. */
function metresOf(quantities: readonly Quantity[], bare: number): readonly number[] {
  const withUnit = quantities.filter(({ unit }) => unit !== undefined);
  const ofAll = withUnit.length === 1 && withUnit[0] === quantities.at(-1) ? withUnit[0]?.unit : undefined;
  return quantities.map(({ value, unit, text }) => {
    if (unit === undefined && ofAll === undefined && withUnit.length > 0) {
      throw new CoordinatesError(`${text} has no unit, and others have one.`);
    }
    return value * (unit ?? ofAll ?? bare);
  });
}

/** East, north and up, by their directions, or without any by their order. */
function inOrder(quantities: readonly Quantity[], metres: readonly number[]): Point {
  const unnamed = quantities.find(({ direction }) => direction === undefined);
  if (unnamed !== undefined && quantities.some(({ direction }) => direction !== undefined)) {
    throw new CoordinatesError(`${unnamed.text} has no letter: give all three one, or none.`);
  }
  if (unnamed !== undefined && quantities.length !== 3) {
    const count = quantities.length === 1 ? "That is one number" : `These are ${quantities.length} numbers`;
    throw new CoordinatesError(`${count}: it takes three, for E, N and U.`);
  }
  return pointOf((axis) => {
    const own = quantities.flatMap(({ direction }, index) => {
      const named = direction ?? { axis: index, sign: 1 };
      return named.axis === axis ? named.sign * (metres[index] ?? 0) : [];
    });
    if (own.length !== 1) {
      throw new CoordinatesError(`${LETTERS[axis]} is ${own.length === 0 ? "missing" : "given twice"}.`);
    }
    return own[0] ?? 0;
  });
}

/** The value of a numeral with a decimal point or comma, and perhaps marks between thousands. */
function numberOf(text: string): number {
  const plain = text.replace("−", "-");
  if (/^[+-]?\d{1,3},\d{3}$/.test(plain)) {
    const [whole, digits] = plain.split(",");
    throw new CoordinatesError(
      `${text} may be ${whole}.${digits} or ${whole}${digits}: leave the comma out.`,
    );
  }
  if (/^[+-]?\d{1,3}(,\d{3})+\.\d*$|^[+-]?\d{1,3}(,\d{3}){2,}$/.test(plain)) {
    return Number(plain.replaceAll(",", ""));
  }
  if (/^[+-]?\d{1,3}(\.\d{3})+,\d*$|^[+-]?\d{1,3}(\.\d{3}){2,}$/.test(plain)) {
    return Number(plain.replaceAll(".", "").replace(",", "."));
  }
  const value = Number(plain.replace(",", "."));
  if (Number.isNaN(value)) {
    throw new CoordinatesError(`${text} is no number.`);
  }
  return value;
}
