/** The keyboard focus: it enters a panel that a key opens, and outlives the element that has it. */

import { takesKey } from "../navigate/typing.ts";

/**
 * Focuses the first control of the panel that `key` has opened, once its code and its rows are there. Any
 * input before that ends the wait. Fields of text are passed over: the key is to close the panel again.
 */
export function enterPanel(name: string, key: string): void {
  const ending = new AbortController();
  const enter = () => {
    const controls = document.querySelectorAll<HTMLElement>(
      `#panel-${name} > :not(header) :is(button, input, select, [tabindex])`,
    );
    const first = [...controls].find((one) => {
      return one.tabIndex === 0 && !one.matches(":disabled") && !takesKey(one, key);
    });
    if (first !== undefined) {
      ending.abort();
      first.focus();
    }
  };
  const observer = new MutationObserver(enter);
  const options = { capture: true, signal: ending.signal } as const;
  ending.signal.addEventListener("abort", () => observer.disconnect());
  for (const kind of ["keydown", "pointerdown"] as const) {
    addEventListener(kind, () => ending.abort(), options);
  }
  observer.observe(document.body, { childList: true, subtree: true });
}

/**
 * Focuses `home` whenever the focused element in `place` is removed: else the next key of a person would
 * begin at the top of the page.
 */
export function keepFocus(place: HTMLElement, home: HTMLElement): void {
  let last: Element | undefined;
  addEventListener("focusin", ({ target }) => {
    last = target instanceof Element ? target : undefined;
  });
  new MutationObserver(() => {
    if (last?.isConnected === false && document.activeElement === document.body) {
      home.focus({ preventScroll: true });
    }
  }).observe(place, { childList: true, subtree: true });
}
