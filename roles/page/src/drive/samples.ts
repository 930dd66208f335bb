/** Numbers of which a few are told. */
export class Samples {
  readonly #all: number[] = [];

  add(sample: number): void {
    this.#all.push(sample);
  }

  /** The number that this share of all are not above: 0.5 gives the median. Zero where there are none. */
  share(share: number): number {
    const sorted = [...this.#all].sort((a, b) => a - b);
    return sorted[Math.max(0, Math.ceil(share * sorted.length) - 1)] ?? 0;
  }
}
