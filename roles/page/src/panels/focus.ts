/** Where the keyboard goes when what had it is gone. */

/**
 * Gives the keyboard to `home` whenever something in `place` that had it is taken away: else the next key of
 * a person would begin at the top of the page.
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
