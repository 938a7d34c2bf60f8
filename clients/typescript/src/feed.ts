/** What waits for its reader: bounded, the oldest goes first; an async iterator over it. */
export class Feed<T> implements AsyncIterableIterator<T> {
  /** Items that came faster than they were read, and are lost. */
  missed = 0;
  #items: T[] = [];
  #waiting: ((result: IteratorResult<T>) => void)[] = [];
  #closed = false;

  constructor(private readonly limit: number, private readonly release: () => void, signal?: AbortSignal) {
    signal?.addEventListener("abort", () => this.close(), { once: true });
  }

  push(item: T): void {
    if (this.#closed) return;
    const waiting = this.#waiting.shift();
    if (waiting) { waiting({ value: item, done: false }); return; }
    if (this.#items.length >= this.limit) { this.#items.shift(); this.missed += 1; }
    this.#items.push(item);
  }

  /** Stops listening; a reader that waits sees the end. */
  close(): void {
    if (this.#closed) return;
    this.#closed = true;
    this.release();
    for (const waiting of this.#waiting.splice(0)) waiting({ value: undefined, done: true });
  }

  async next(): Promise<IteratorResult<T>> {
    const item = this.#items.shift();
    if (item !== undefined) return { value: item, done: false };
    if (this.#closed) return { value: undefined, done: true };
    return new Promise((resolve) => this.#waiting.push(resolve));
  }

  async return(): Promise<IteratorResult<T>> { this.close(); return { value: undefined, done: true }; }

  [Symbol.asyncIterator](): this { return this; }
}
