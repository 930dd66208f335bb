/** Keys that belong to the focused control, and so are no shortcuts. */

const ARROWS = ["ArrowUp", "ArrowDown", "ArrowLeft", "ArrowRight"];
const PAGES = ["Home", "End", "PageUp", "PageDown"];
const PRESS = [" ", "Enter"];

/** Kinds of controls, and the keys that each takes: the first match counts. */
const CONTROLS: readonly (readonly [selector: string, keys: readonly string[] | "all"])[] = [
  ["input[type=range], [role=slider]", [...ARROWS, ...PAGES]],
  ["input[type=checkbox], [role=switch]", [" "]],
  ["input[type=radio]", [" ", ...ARROWS]],
  ["input[type=file], input[type=button], input[type=submit], input[type=reset]", PRESS],
  ["input, textarea, [contenteditable]:not([contenteditable=false])", "all"],
  ["select, [role=listbox], [role=tree]", [...ARROWS, ...PAGES, ...PRESS]],
  ["button, summary, [role=button]", PRESS],
  ["a[href]", ["Enter"]],
];

/** An element's test: whether it is within a match of a selector. */
export type Within = Pick<Element, "closest">;

/** Whether the control around `target` handles a key itself, by platform convention. */
export function takesKey(target: Within, key: string): boolean {
  const control = CONTROLS.find(([selector]) => target.closest(selector) !== null);
  return control !== undefined && (control[1] === "all" || control[1].includes(key));
}

/** Whether a key is no shortcut: it is for the focused control, or for a modal dialog. */
export function isForControl({ target, key }: KeyboardEvent): boolean {
  const isTaken = target instanceof Element && takesKey(target, key);
  return isTaken || document.querySelector("dialog:modal") !== null;
}
