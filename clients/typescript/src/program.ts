import type { MachineCalls } from "./calls.js";
import type { Connection } from "./connection.js";
import { type MotionError, NobodyAnswers, ProgramRejected, RequestRefused } from "./errors.js";
import type { Ack, Continuation, ContinueReply, ContinueRequest, Info, OpenReply, OpenRequest, OverrideReply, ProgramState, ProgramStatus, SubmitReply } from "./messages.js";
import { LineWindow } from "./window.js";
import { SURROGATE, understand } from "./wire.js";

export interface ContinueOptions {
  /** Gets what ran, where the axes stand and where the program has them, before anything moves; where it rejects, nothing does. */
  show?: (shown: Continuation) => unknown;
  /** How long the motion server may be away before NobodyAnswers [ms]; default 30 s. */
  patienceMs?: number;
}

/** The machine of a program. */
export type Behind = MachineCalls & { readonly name: string; readonly info: Info };

const GIVE_LINES = 1000;
const DOUBT_MS = 2000;
const ASK_MS = 250;
const PATIENCE_MS = 30_000;

/**
 * One stream of lines with modal state and axes of its own. Whatever is not known to be accepted is sent again after a loss: nothing is lost
 * and nothing runs twice. One call at a time sends; others wait for it.
 */
export class Program {
  readonly #window: LineWindow;
  #changed: (() => void)[] = [];
  #stop: (() => void) | null = null;
  #turn: Promise<void> = Promise.resolve();
  #heard = Date.now();
  /** When targets were sent last since the server was heard, by the sender's clock [s]; null: none were. */
  asked: number | null = null;
  /** How long the server has been silent up to then [s]. */
  silentS = 0;
  /** What `waitDone` has rejected with. */
  #told: MotionError | null = null;

  private constructor(private readonly machine: Behind, readonly id: string, opened: OpenReply | ContinueReply, private readonly patienceMs: number) {
    this.#window = new LineWindow(opened);
  }

  static async open(gateway: Connection, machine: Behind, request: OpenRequest, patienceMs?: number): Promise<Program> {
    return Program.follow(gateway, machine, understand<OpenReply>("OpenReply", await machine.openProgram(request)), patienceMs);
  }

  static async goOn(gateway: Connection, machine: Behind, request: ContinueRequest, { show, patienceMs }: ContinueOptions): Promise<Program> {
    if (show) await show(await machine.continuation({ program: request.program, line: request.line }));
    const opened = understand<ContinueReply>("ContinueReply", await machine.openContinuation(request));
    return Program.follow(gateway, machine, opened, patienceMs);
  }

  /** Hears of a program that was opened. */
  static async follow(gateway: Connection, machine: Behind, opened: OpenReply | ContinueReply, patienceMs = PATIENCE_MS): Promise<Program> {
    const program = new Program(machine, opened.program, opened, patienceMs);
    try {
      const stop = await gateway.listen(machine.name, `ack/${program.id}`, (message: unknown) => program.#onAck(message), () => program.#change((window) => { window.stale = true; }));
      program.#change(() => { program.#stop = stop; });
    } catch (error) {
      await program.abort().catch(() => undefined);
      throw error;
    }
    return program;
  }

  /** Lines through this number are taken and journaled by the server. */
  get accepted(): number { return this.#window.accepted; }
  /** Lines through this number have ended. */
  get done(): number { return this.#window.done; }
  /** Number of the last line given. */
  get given(): number { return this.#window.given; }
  get state(): ProgramState { return this.#window.state; }
  get ended(): boolean { return this.#window.ended; }

  /** What `finish` will reject with, as soon as it is known: a fault, or a line that was found faulty late. */
  get failure(): MotionError | null { return this.#window.failure; }

  /**
   * Streams lines as the server takes them, each as soon as it is there; resolves with the last one's number once all are accepted. Where the
   * signal aborts, or `lines` throws, what has not been sent is given up; what is under way may be accepted.
   */
  sendLines(lines: Iterable<string> | AsyncIterable<string>, signal?: AbortSignal): Promise<number> {
    return this.#inTurn(async () => {
      const source = Symbol.asyncIterator in lines ? lines[Symbol.asyncIterator]() : lines[Symbol.iterator]();
      const broken = new AbortController();
      const both = signal ? AbortSignal.any([signal, broken.signal]) : broken.signal;
      let sending: Promise<void> | null = null;
      // rejects as soon as a line is refused, whatever the source waits for
      let fail: (reason: unknown) => void = () => {};
      const failed = new Promise<never>((_, reject) => { fail = reject; });
      failed.catch(() => undefined);
      const send = (): void => { sending ??= this.#drain(false, both).then(() => { sending = null; }, (reason: unknown) => { fail(reason); }); };
      const aborted = (): void => fail(signal!.reason);
      signal?.addEventListener("abort", aborted, { once: true });
      try {
        signal?.throwIfAborted();
        for (;;) {
          const next = source.next();
          const { done, value } = next instanceof Promise ? await Promise.race([next, failed]) : next;
          if (done) break;
          this.#window.give(this.#checked(value));
          send();
          while (sending !== null && this.#window.given - this.#window.accepted >= GIVE_LINES) await Promise.race([this.#moved(), failed]);
        }
        while (sending !== null) await Promise.race([sending, failed]);
        await this.#drain(false, signal);
        return this.accepted;
      } catch (error) {
        broken.abort(error);
        void Promise.resolve(source.return?.()).catch(() => undefined);
        await sending;
        throw error;
      } finally { signal?.removeEventListener("abort", aborted); }
    });
  }

  /** Sends one line and waits for the verdict on it: ProgramRejected where it has faults, and the program lives on. */
  send(line: string, signal?: AbortSignal): Promise<number> {
    return this.#inTurn(async () => {
      const number = this.#window.give(this.#checked(line));
      await this.#drain(true, signal);
      return number;
    });
  }

  /** No more lines will come; what is accepted runs to its end. */
  close(): Promise<void> {
    return this.#inTurn(async () => {
      try {
        const reply = await this.machine.closeProgram({ program: this.id, last: this.accepted });
        // why it has ended is not in this reply
        this.#hear((window) => { window.stale ||= reply.state !== "running"; });
      } catch (error) {
        // the likely reason is the program's end, or a line that was found faulty
        await this.#ask(error);
        if (this.#window.failure) throw this.#window.failure;
        if (!this.ended) throw error;
      }
    });
  }

  /** `close`, then waits until the program has finished; rejects as it ended otherwise, of a faulty line once what is before it has run. */
  async finish(signal?: AbortSignal): Promise<void> {
    let rejection: ProgramRejected | null = null;
    if (!this.ended) {
      try { await this.close(); } catch (error) {
        if (!(error instanceof ProgramRejected) || this.ended) throw error;
        rejection = error;
        await this.close();
      }
    }
    await this.#until((window) => window.ended || (window.failure !== null && !(window.failure instanceof ProgramRejected)), signal);
    if (this.#window.failure) throw this.#window.failure;
    if (rejection) throw rejection;
  }

  /** Resolves once the line with this number has ended, or the program has finished; rejects as soon as that cannot be. */
  async waitDone(line: number, signal?: AbortSignal): Promise<void> {
    await this.#until((window) => window.done >= line || window.ended || window.failure !== null, signal);
    if (this.done >= line || this.state === "finished") return;
    this.#told = this.#window.failure;
    throw this.#told;
  }

  hold(): Promise<string[]> { return this.machine.hold(this.id); }
  resume(): Promise<string[]> { return this.machine.resume(this.id); }
  abort(): Promise<string[]> { return this.machine.abort(this.id); }
  override(percent: number): Promise<OverrideReply> { return this.machine.override({ percent, program: this.id }); }

  /** One call after the other; what a call gave and is not accepted at its end is given up. */
  #inTurn<T>(send: () => Promise<T>): Promise<T> {
    const mine = this.#turn.then(async () => {
      try {
        while (this.#window.adrift) await this.#ask();
        // the application knows of it, and gives the line again
        if (this.#window.failure === this.#told) this.#window.forgive();
        if (this.#window.failure) throw this.#window.failure;
        if (this.ended) throw new RequestRefused("MC536", `the program takes no more lines: it is ${this.state}`, "open another one");
        return await send();
      } catch (error) {
        if (error === this.#window.failure) this.#window.forgive();
        throw error;
      } finally { this.#window.abandon(); }
    });
    this.#turn = mine.then(() => undefined, () => undefined);
    return mine;
  }

  /** Sends what waits until all of it is accepted. */
  async #drain(judge: boolean, signal?: AbortSignal): Promise<void> {
    for (;;) {
      const message = this.#window.next();
      if (this.#window.failure) throw this.#window.failure;
      signal?.throwIfAborted();
      if (!this.#window.pending) return;
      if (message) await this.#submit(message, judge);
      // lines whose fate is not known are asked for before anything else is sent
      else await this.#until((window) => (!window.uncertain && window.credit > 0) || window.failure !== null || !window.pending, signal);
    }
  }

  async #submit(message: { first: number; lines: string[]; rejections: number }, judge: boolean): Promise<void> {
    try {
      const reply = understand<SubmitReply>("SubmitReply", await this.machine.submitLines({ program: this.id, ...message, judge }));
      this.#hear((window) => window.answered(reply));
    } catch (error) {
      if (error instanceof NobodyAnswers && error.code !== "MC539") { await this.#ask(error); return; }
      if (!(error instanceof RequestRefused)) throw error;
      let left: RequestRefused | null = null;
      this.#hear((window) => { left = window.refused(error); });
      if (left) throw left;
    }
    if (this.#window.stale) await this.#ask();
  }

  /** Asks what the server has; while it is away, until the patience is over. */
  async #ask(away?: unknown): Promise<void> {
    try {
      const found = (await this.machine.programs({ program: this.id })).map((each) => understand<ProgramStatus>("ProgramStatus", each));
      const mine = found.find((each) => each.program === this.id) ?? null;
      this.#hear((window) => window.asked(mine));
    } catch (error) {
      if (error instanceof RequestRefused && error.code === "MC503") this.#hear((window) => window.asked(null));
      else if (error instanceof NobodyAnswers && error.code !== "MC539" && Date.now() - this.#heard < this.patienceMs) {
        this.#window.stale = true;
        await new Promise((resolve) => setTimeout(resolve, ASK_MS));
      } else throw away instanceof NobodyAnswers ? away : error;
    }
  }

  /** Waits for a condition; after a silence, or where something does not fit, the server is asked. */
  async #until(holds: (window: LineWindow) => boolean, signal?: AbortSignal): Promise<void> {
    while (!holds(this.#window)) {
      signal?.throwIfAborted();
      if (this.#window.stale || !(await this.#news(signal))) await this.#ask();
    }
  }

  /** Whether something has changed before the silence was too long. */
  #news(signal?: AbortSignal): Promise<boolean> {
    return new Promise((resolve, reject) => {
      const end = (): void => { clearTimeout(timer); signal?.removeEventListener("abort", abort); };
      const abort = (): void => { end(); reject(signal?.reason); };
      const timer = setTimeout(() => { end(); resolve(false); }, DOUBT_MS);
      signal?.addEventListener("abort", abort, { once: true });
      this.#changed.push(() => { end(); resolve(true); });
    });
  }

  #onAck(message: unknown): void {
    try {
      const ack = understand<Ack>("Ack", message);
      this.#hear((window) => window.acknowledged(ack));
    } catch { /* of another version: the server is asked after a silence */ }
  }

  /** Resolves with the next change. */
  #moved(): Promise<void> { return new Promise((resolve) => { this.#changed.push(resolve); }); }

  #checked(line: string): string {
    const text = line.replace(/[\r\n]+$/, "");
    const limit = this.machine.info.limits?.max_line_length;
    if (/[\r\n]/.test(text)) throw new RequestRefused("MC538", "a line must not hold a line end", "split the text into lines");
    if (SURROGATE.test(text)) throw new RequestRefused("MC538", "the line holds half a character (a lone surrogate), which no text has", "send whole characters");
    if (limit && [...text].length > limit) throw new RequestRefused("MC538", `the line has ${[...text].length} characters, the server takes ${limit}`, "break it at a command");
    return text;
  }

  /** Takes what the server says. */
  #hear(apply: (window: LineWindow) => void): void {
    this.#heard = Date.now();
    this.asked = null;
    this.silentS = 0;
    this.#change(apply);
  }

  #change(apply: (window: LineWindow) => void): void {
    apply(this.#window);
    if (this.ended && this.#stop) { this.#stop(); this.#stop = null; }
    for (const changed of this.#changed.splice(0)) changed();
  }
}
