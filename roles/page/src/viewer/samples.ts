/** Samples, with their statistics. */
export class Samples {
  readonly #all: number[] = [];

  add(sample: number): void {
    this.#all.push(sample);
  }

  get count(): number {
    return this.#all.length;
  }

  countOf(counts: (sample: number) => boolean): number {
    return this.#all.filter(counts).length;
  }

  /** Zero without samples. */
  get mean(): number {
    return this.#all.reduce((sum, sample) => sum + sample, 0) / Math.max(1, this.count);
  }

  /** The smallest number not below this share of all: 0.5 gives the median. Zero without samples. */
  share(share: number): number {
    const sorted = [...this.#all].sort((a, b) => a - b);
    return sorted[Math.max(0, Math.ceil(share * sorted.length) - 1)] ?? 0;
  }
}
