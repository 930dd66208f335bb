/** Lengths as a person reads them. */

import { signal } from "@preact/signals";

export const UNITS = ["m", "mm", "ft-in"] as const;
export type Unit = (typeof UNITS)[number];

/** Below this a millimetre is coarse: there are two more digits. Metres. */
const SMALL = 0.01;
const INCH = 0.0254;
const STORED = "trimaran-unit";

/** The unit that this person reads. */
export const unit = signal<Unit>(storedUnit());

export function chooseUnit(chosen: Unit): void {
  unit.value = chosen;
  try {
    localStorage.setItem(STORED, chosen);
  } catch {
    // A browser that stores nothing keeps it as long as the page is open.
  }
}

/** A length of so many metres, in whole millimetres or as fine in feet and inches. */
export function lengthText(metres: number, unit: Unit): string {
  return written(metres, unit, moreDigits(metres));
}

function moreDigits(metres: number): number {
  return metres !== 0 && Math.abs(metres) < SMALL ? 2 : 0;
}

function written(metres: number, unit: Unit, digits: number): string {
  const sign = metres < 0 ? "-" : "";
  const length = Math.abs(metres);
  switch (unit) {
    case "m":
      return `${sign}${length.toFixed(3 + digits)} m`;
    case "mm":
      return `${sign}${(1000 * length).toFixed(digits)} mm`;
    case "ft-in": {
      // Rounded before it is divided: there are no 12 inches.
      const parts = 100 * 10 ** digits;
      const all = Math.round((parts * length) / INCH);
      const feet = Math.floor(all / (12 * parts));
      const inches = ((all - 12 * parts * feet) / parts).toFixed(2 + digits);
      return `${sign}${feet === 0 ? "" : `${feet}' `}${inches}"`;
    }
  }
}

/**
 * The same, of a length that may be off by `error` metres; by how much is unknown where that is nothing. Less
 * than half of the last digit does not count.
 */
export function measuredText(metres: number, error: number | undefined, unit: Unit): string {
  const text = lengthText(metres, unit);
  if (error === undefined) {
    return `about ${text}`;
  }
  const digits = moreDigits(metres);
  const last = (unit === "ft-in" ? INCH / 100 : 0.001) / 10 ** digits;
  // Up to the last digit of the length: it is a bound. What is but a rounding above a digit is that digit.
  const bound = last * Math.ceil(error / last - 1e-6);
  return error < last / 2 ? text : `${text} ± ${written(bound, unit, digits)}`;
}

function storedUnit(): Unit {
  try {
    const stored = localStorage.getItem(STORED);
    return UNITS.find((unit) => unit === stored) ?? "m";
  } catch {
    return "m";
  }
}
