import { Feed } from "./feed.js";
import type { Gateway } from "./gateway.js";
import type { CheckResult, EventPage, Info, MachineStatus, MotionEvent, ProgramStatus, Samples } from "./messages.js";
import { type OpenOptions, Program } from "./program.js";
import { columnsOf, understand } from "./wire.js";

const KEEP_MS = 100;
const HOLD_S = 0.35;

/** A machine behind a gateway. */
export class Machine {
  private constructor(private readonly gateway: Gateway, readonly name: string, readonly info: Info) {}

  static async open(gateway: Gateway, name: string): Promise<Machine> {
    const info = await gateway.request<Info>({ op: "call", machine: name, method: "info", params: {} });
    return new Machine(gateway, name, info);
  }

  /** Any remote method by its name (docs/wire/calls.md). */
  call<T>(method: string, params: Record<string, unknown> = {}): Promise<T> {
    return this.gateway.request<T>({ op: "call", machine: this.name, method, params });
  }

  status(): Promise<MachineStatus> { return this.call("status"); }
  async programs(program?: string): Promise<ProgramStatus[]> {
    return (await this.call<{ programs: ProgramStatus[] }>("programs", program === undefined ? {} : { program })).programs;
  }
  check(text: string): Promise<CheckResult> { return this.call("check", { text }); }
  simulate(text: string): Promise<Record<string, unknown>> { return this.call("simulate", { text }); }
  hold(program?: string): Promise<unknown> { return this.call("hold", { program: program ?? null }); }
  resume(program?: string): Promise<unknown> { return this.call("resume", { program: program ?? null }); }
  abort(program?: string): Promise<unknown> { return this.call("abort", { program: program ?? null }); }
  override(percent: number, program?: string): Promise<unknown> { return this.call("override", { percent, program: program ?? null }); }
  /** Lets axes find their references (all that can, without `axes`); the program goes on by itself, `abort` stops it. */
  home(axes?: number[]): Promise<{ program: string; axes: number[] }> { return this.call("home", { axes: axes ?? null }); }
  /** Says where axes are, by number [mm, deg]; nothing moves. */
  reference(positions: Record<string, number>): Promise<unknown> { return this.call("reference", { positions }); }
  reset(): Promise<unknown> { return this.call("reset"); }

  /** Emergency stop, on a connection of its own too; resolves once the server has confirmed it. No safety function: machines need a circuit of their own. */
  estop(reason = ""): Promise<void> { return this.gateway.estop(this.name, reason); }

  /** A new program; lines are streamed to it, each exactly once. */
  program(options: OpenOptions = {}): Promise<Program> { return Program.open(this.gateway, this, options); }

  /** Sets an output by its name: a digital one true or false, an analog one in its unit. */
  setOutput(output: string, value: boolean | number): Promise<{ name: string; value: number }> {
    return this.call("set_output", { output, value });
  }

  /** Sets a simulated input by its name. */
  setSimulatedInput(input: string, value: boolean | number): Promise<{ name: string; value: number }> {
    return this.call("set_simulated_input", { input, value });
  }

  /** Moves an axis by a distance [mm, deg]. */
  jog(axis: number, distance: number, velocity?: number): Promise<{ program: string }> {
    return this.call("jog", { axis, distance, velocity: velocity ?? null });
  }

  /**
   * Moves an axis until the signal aborts; `velocity` is signed [mm/s, deg/s]. The server's dead man's time stops it when this
   * page, its link or the gateway dies.
   */
  async jogWhile(axis: number, velocity: number, signal: AbortSignal): Promise<void> {
    const { program } = await this.call<{ program: string }>("jog", { axis, velocity, hold_s: HOLD_S });
    try {
      while (!signal.aborted) {
        await pause(KEEP_MS, signal);
        if (!signal.aborted) await this.call("jog", { axis, velocity, hold_s: HOLD_S, program });
      }
    } finally {
      // it may have ended by itself: at a limit, by a fault, or for want of keeps
      await this.abort(program).catch(() => undefined);
    }
  }

  /** The whole machine some 20 times a second; a slow reader gets the newest states. */
  states(signal?: AbortSignal): Promise<Feed<MachineStatus>> { return this.#feed<MachineStatus>("state", 32, (message) => message, signal); }

  /** Every cycle of every axis, some cycles at a time; a jump of `seq` means cycles lost on the way. */
  samples(signal?: AbortSignal): Promise<Feed<Samples>> { return this.#feed("samples", 4096, (message) => this.#samplesOf(message), signal); }

  /** Events in order and without a gap: what was lost with a connection is asked for again. */
  async events(signal?: AbortSignal): Promise<Feed<MotionEvent>> {
    let last = (await this.call<EventPage>("events", { since: 2 ** 52, limit: 1 })).newest;
    let instance = this.info.instance;
    let catching: Promise<void> | null = null;
    let stop = (): void => {};
    const feed = new Feed<MotionEvent>(4096, () => stop(), signal);
    const take = (event: MotionEvent): void => {
      if (event.instance !== instance) { instance = event.instance; last = 0; }
      if (event.seq === last + 1) { last = event.seq; feed.push(event); }
      else if (event.seq > last) void catchUp();
    };
    const catchUp = (): Promise<void> => catching ??= (async () => {
      try {
        const page = await this.call<EventPage>("events", { since: last + 1, limit: 1000 });
        if (page.instance === instance && page.oldest > last + 1) last = page.oldest - 1;
        catching = null;
        for (const event of page.events) take(event);
      } catch { catching = null; }
    })();
    const hear = (message: unknown): void => { try { take(understand<MotionEvent>("Event", message)); } catch { /* of another version */ } };
    stop = await this.gateway.listen(this.name, "events", hear, () => void catchUp());
    return feed;
  }

  async #feed<T>(topic: string, limit: number, convert: (message: any) => T, signal?: AbortSignal): Promise<Feed<T>> {
    let stop = (): void => {};
    const feed = new Feed<T>(limit, () => stop(), signal);
    stop = await this.gateway.listen(this.name, topic, (message) => {
      // what is not understood costs itself only
      try { feed.push(convert(message)); } catch { /* of another version */ }
    });
    return feed;
  }

  #samplesOf(block: unknown): Samples {
    const { axes, fields } = this.info.telemetry;
    return { ...columnsOf(block, axes.length, fields), cycleS: this.info.cycle_s, axes };
  }
}

function pause(ms: number, signal: AbortSignal): Promise<void> {
  return new Promise((resolve) => {
    const timer = setTimeout(resolve, ms);
    signal.addEventListener("abort", () => { clearTimeout(timer); resolve(); }, { once: true });
  });
}
