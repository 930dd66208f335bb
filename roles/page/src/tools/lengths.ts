/** Lengths as a person reads them. */

import { signal } from "@preact/signals";

export const UNITS = ["m", "mm", "ft-in"] as const;
export type Unit = (typeof UNITS)[number];

/** Below this a millimetre is coarse: there are two more digits. Metres. */
const SMALL = 0.01;
/** Metres. */
export const INCH = 0.0254;
const STORED = "trimaran-unit";

/** This person's unit. */
export const unit = signal<Unit>(storedUnit());

export function chooseUnit(chosen: Unit): void {
  unit.value = chosen;
  try {
    localStorage.setItem(STORED, chosen);
  } catch {
    // Without storage the browser keeps it as long as the page is open.
  }
}

/** A length of this many metres, in whole millimetres or as fine in feet and inches. */
export function lengthText(metres: number, unit: Unit): string {
  return written(metres, unit, moreDigits(metres));
}

/** A coordinate of this many metres, in whole millimetres or as fine in feet and inches. */
export function coordinateText(metres: number, unit: Unit): string {
  const text = written(metres, unit, 0);
  // Zero has no sign.
  return /[1-9]/.test(text) ? text : text.replace("-", "");
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
      // Rounded before it is divided, so that 12 inches never appear.
      const parts = 100 * 10 ** digits;
      const all = Math.round((parts * length) / INCH);
      const feet = Math.floor(all / (12 * parts));
      const inches = ((all - 12 * parts * feet) / parts).toFixed(2 + digits);
      return `${sign}${feet === 0 ? "" : `${feet}' `}${inches}"`;
    }
  }
}

/**
 * The same for a length with an error of `error` metres; undefined if unknown. An error below half of the
 * last digit is not shown.
 */
export function measuredText(metres: number, error: number | undefined, unit: Unit): string {
  const text = lengthText(metres, unit);
  if (error === undefined) {
    return `about ${text}`;
  }
  const digits = moreDigits(metres);
  const last = (unit === "ft-in" ? INCH / 100 : 0.001) / 10 ** digits;
  // The error is a bound, rounded up to the last digit. An excess by rounding alone does not count.
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
