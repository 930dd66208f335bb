/** Tasks of the page that keep it from answering for more than 50 ms (W3C Long Tasks API). */

export class LongTasks {
  readonly #milliseconds: number[] = [];
  readonly #observer: PerformanceObserver | undefined;

  /** Counts from now on. */
  constructor() {
    // Not every browser reports them.
    if (PerformanceObserver.supportedEntryTypes.includes("longtask")) {
      this.#observer = new PerformanceObserver((list) => this.#add(list.getEntries()));
      this.#observer.observe({ type: "longtask" });
    }
  }

  /** Ends, and tells how many there were, and the longest; nothing if the browser does not tell. */
  end(): { readonly count: number; readonly longestMs: number } | null {
    if (this.#observer === undefined) {
      return null;
    }
    this.#add(this.#observer.takeRecords());
    this.#observer.disconnect();
    return { count: this.#milliseconds.length, longestMs: Math.max(0, ...this.#milliseconds) };
  }

  #add(entries: PerformanceEntryList): void {
    this.#milliseconds.push(...entries.map(({ duration }) => duration));
  }
}
