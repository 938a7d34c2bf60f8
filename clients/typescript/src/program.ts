import { type MotionError, ProgramEnded, ProgramRejected, RequestRefused } from "./errors.js";
import type { Gateway } from "./gateway.js";
import type { Machine } from "./machine.js";
import { type Ack, ENDED, type ProgramState } from "./messages.js";

export interface OpenOptions {
  /** For people: a file's name. */
  name?: string;
  /** The axes to lease; left out: all of the machine. */
  axes?: number[];
  /** What happens when this client is gone for longer than the gateway's grace. */
  onDisconnect?: "finish" | "stop";
  startLine?: number;
  before?: string[];
  hold?: boolean;
}

const CHUNK_LINES = 1000;
const DOUBT_MS = 2000;

/**
 * One stream of lines with modal state and axes of its own. Line n is taken only after line n - 1, a repeat is never run again:
 * so whatever is not known to be accepted is sent again after a loss, and nothing is lost or runs twice.
 */
export class Program {
  accepted: number;
  done: number;
  state: ProgramState;
  #credit: number;
  #failure: MotionError | null = null;
  #changed: (() => void)[] = [];
  #stop: () => void = () => {};

  private constructor(private readonly gateway: Gateway, private readonly machine: Machine, readonly id: string, opened: { state: ProgramState; expected: number; credit: number }) {
    this.accepted = this.done = opened.expected - 1;
    this.#credit = opened.credit;
    this.state = opened.state;
  }

  static async open(gateway: Gateway, machine: Machine, options: OpenOptions): Promise<Program> {
    const opened = await machine.call<{ program: string; state: ProgramState; expected: number; credit: number }>("open", {
      name: options.name ?? "", axes: options.axes ?? null, on_disconnect: options.onDisconnect ?? "stop",
      start_line: options.startLine ?? 1, before: options.before ?? [], hold: options.hold ?? false,
    });
    const program = new Program(gateway, machine, opened.program, opened);
    program.#stop = await gateway.listen(machine.name, `ack/${program.id}`, (ack: Ack) => program.#take(ack), () => void program.#ask());
    return program;
  }

  get ended(): boolean { return ENDED.has(this.state); }

  /** Streams lines as the server takes them; resolves with the last one's number once all are accepted. */
  async sendLines(lines: Iterable<string> | AsyncIterable<string>, signal?: AbortSignal): Promise<number> {
    let chunk: string[] = [];
    for await (const line of lines as AsyncIterable<string>) {
      chunk.push(line);
      if (chunk.length >= CHUNK_LINES) { await this.#submit(chunk, signal); chunk = []; }
    }
    if (chunk.length) await this.#submit(chunk, signal);
    return this.accepted;
  }

  /** Sends one line and waits for the verdict on it: ProgramRejected where it has faults, and the program lives on. */
  async send(line: string): Promise<number> {
    try {
      this.#numbers(await this.machine.call("submit", { program: this.id, first: this.accepted + 1, lines: [line], judge: true }));
    } catch (error) { throw this.#meaning(error); }
    return this.accepted;
  }

  /** No more lines will come; resolves once the program has finished, rejects as it ended otherwise. */
  async finish(signal?: AbortSignal): Promise<void> {
    try {
      await this.machine.call("close", { program: this.id, last: this.accepted });
    } catch (error) { if (!this.ended) throw this.#meaning(error); }
    while (!this.ended) { this.#raise(); await this.#wait(signal); }
    this.#stop();
    if (this.state !== "finished") throw this.#failure ?? new ProgramEnded(this.state, "MC535", `the program is ${this.state}`);
  }

  hold(): Promise<unknown> { return this.machine.hold(this.id); }
  resume(): Promise<unknown> { return this.machine.resume(this.id); }
  abort(): Promise<unknown> { return this.machine.abort(this.id); }
  override(percent: number): Promise<unknown> { return this.machine.override(percent, this.id); }

  async #submit(lines: string[], signal?: AbortSignal): Promise<void> {
    const through = this.accepted + lines.length;
    const start = this.accepted;
    while (this.accepted < through) {
      this.#raise();
      signal?.throwIfAborted();
      const rest = lines.slice(this.accepted - start, this.accepted - start + Math.max(0, this.#credit));
      if (!rest.length) { await this.#wait(signal); continue; }
      try {
        this.#numbers(await this.machine.call("submit", { program: this.id, first: this.accepted + 1, lines: rest, judge: false }));
      } catch (error) {
        if (error instanceof RequestRefused && error.code === "MC505") { this.#numbers(error.details as unknown as Ack); continue; }
        throw this.#meaning(error);
      }
    }
  }

  #numbers(reply: { accepted: number; done: number; credit: number }): void {
    this.accepted = Math.max(this.accepted, reply.accepted);
    this.done = Math.max(this.done, reply.done);
    this.#credit = reply.credit;
  }

  #take(ack: Ack): void {
    this.#numbers(ack);
    if (!this.ended) this.state = ack.state;
    if (ack.rejected) this.#failure = new ProgramRejected(ack.diagnostics?.[0]?.code ?? "MC100", ack.diagnostics?.[0]?.message ?? `line ${ack.rejected} is faulty`, ack.diagnostics?.[0]?.hint, { line: ack.rejected }, ack.diagnostics ?? []);
    else if (ack.fault) this.#failure = new ProgramEnded(ack.state, ack.fault.code, ack.fault.message, ack.fault.hint);
    else if (this.ended && this.state !== "finished") this.#failure = new ProgramEnded(this.state, this.state === "interrupted" ? "MC534" : "MC535", `the program was ${this.state}`);
    for (const changed of this.#changed.splice(0)) changed();
  }

  async #ask(): Promise<void> {
    try {
      const [status] = await this.machine.programs(this.id);
      if (status) this.#take(status);
    } catch (error) {
      if (error instanceof RequestRefused && error.code === "MC503") this.#take({ program: this.id, accepted: this.accepted, done: this.done, credit: 0, state: "interrupted" });
    }
  }

  #raise(): void { if (this.#failure) throw this.#failure; }

  /** Until something changes; after a silence the server is asked. */
  #wait(signal?: AbortSignal): Promise<void> {
    return new Promise((resolve, reject) => {
      const abort = (): void => { clearTimeout(timer); reject(signal?.reason); };
      const timer = setTimeout(() => { signal?.removeEventListener("abort", abort); void this.#ask().then(resolve); }, DOUBT_MS);
      signal?.addEventListener("abort", abort, { once: true });
      this.#changed.push(() => { clearTimeout(timer); signal?.removeEventListener("abort", abort); resolve(); });
    });
  }

  #meaning(error: unknown): unknown {
    if (error instanceof RequestRefused && error.diagnostics.length) {
      return new ProgramRejected(error.code, error.message, error.hint, error.details, error.diagnostics);
    }
    return this.#failure ?? error;
  }
}
