/** Calls that wait: for an arrival, for room, or until they are aborted. */

/** For calls that wait: they end with the signal's reason once it is aborted. */
export interface Waiting {
  readonly signal?: AbortSignal | undefined;
}

/** A promise that is settled by others, or by its signal: whatever comes first. */
export class Waiter<T> {
  readonly promise: Promise<T>;
  resolve!: (value: T) => void;
  reject!: (error: unknown) => void;

  /** It is among `all` for as long as it waits. Throws if the signal is aborted already. */
  constructor(all: Set<Waiter<T>>, { signal }: Waiting) {
    signal?.throwIfAborted();
    const abort = () => this.reject(signal?.reason);
    const over = () => {
      all.delete(this);
      signal?.removeEventListener("abort", abort);
    };
    this.promise = new Promise((resolve, reject) => {
      this.resolve = (value) => {
        over();
        resolve(value);
      };
      this.reject = (error) => {
        over();
        reject(error);
      };
    });
    all.add(this);
    signal?.addEventListener("abort", abort);
  }
}
