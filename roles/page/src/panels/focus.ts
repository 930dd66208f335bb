/** Keeps the keyboard focus when the focused element is removed. */

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
