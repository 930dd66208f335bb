/** The levels at which a click picks: a primitive, or a group around it. */

import type { Part, PartDetails, SceneDescription } from "../service/service.ts";

/** Their names, from the smallest to the largest. */
export const LEVELS = ["Primitive", "Part", "Equipment", "System"] as const;
export type Level = (typeof LEVELS)[number];

/** Where the browser stores the choice. */
const KEY = "trimaran-level";

/** The levels that a model has. */
export function levelsOf({ groupLevels }: Pick<SceneDescription, "groupLevels">): readonly Level[] {
  return LEVELS.slice(0, 1 + groupLevels);
}

/** The part at a level of an object's hierarchy: the lowest named group is the part, the next the equipment. */
export function atLevel(object: PartDetails, level: Level): Part {
  const names = object.path.map(({ name }) => name);
  return object.path[placeAt(names, level)] ?? object;
}

/** The place in a path of the group at a level; -1 if it is the object itself. */
export function placeAt(path: readonly string[], level: Level): number {
  // The outermost group is the file: a click never picks that.
  const named = [...path.keys()].filter((place) => place > 0 && path[place] !== "");
  const steps = LEVELS.indexOf(level);
  return steps === 0 ? -1 : (named.at(-steps) ?? named[0] ?? -1);
}

/** The next larger group around a part that has a name; nothing if there is none. */
export function parentOf({ path, first, end }: PartDetails): Part | undefined {
  return path.filter((group) => group.name !== "" && group.end - group.first > end - first).at(-1);
}

/** The level that was chosen last. */
export function chosenLevel(): Level {
  try {
    const stored = localStorage.getItem(KEY);
    return LEVELS.find((level) => level === stored) ?? "Primitive";
  } catch {
    return "Primitive";
  }
}

/** Keeps the choice for the next time. */
export function keepLevel(level: Level): void {
  try {
    localStorage.setItem(KEY, level);
  } catch {
    // Without storage it stays as long as the page is open.
  }
}
