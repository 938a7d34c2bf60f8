import { MachineCalls } from "./calls.js";
import { Feed } from "./feed.js";
import type { Connection } from "./connection.js";
import type { ContinueRequest, Info, MachineStatus, MotionEvent, OpenRequest, ServoRequest } from "./messages.js";
import { type ContinueOptions, Program } from "./program.js";
import { Servo } from "./servo.js";
import { type Samples, columnsOf, understand } from "./wire.js";

const KEEP_MS = 100;
const HOLD_S = 0.35;

/** A machine behind a gateway. */
export class Machine extends MachineCalls {
  private constructor(private readonly gateway: Connection, readonly name: string, readonly info: Info) { super(); }

  static async open(gateway: Connection, name: string): Promise<Machine> {
    const info = await gateway.request<Info>({ op: "call", machine: name, method: "info", params: {} });
    return new Machine(gateway, name, info);
  }

  call<T>(method: string, params: object = {}): Promise<T> {
    return this.gateway.request<T>({ op: "call", machine: this.name, method, params });
  }

  /** Emergency stop, on a connection of its own too; resolves once the server has confirmed it. No safety function: machines need a circuit of their own. */
  estop(reason = ""): Promise<void> { return this.gateway.estop(this.name, reason); }

  /** A new program; lines are streamed to it, each exactly once. `patienceMs`: as of `ContinueOptions`. */
  program(request: OpenRequest = {}, patienceMs?: number): Promise<Program> { return Program.open(this.gateway, this, request, patienceMs); }

  /** Leases axes for targets that are streamed, and energizes them; refused (MC512) where one of them is leased. `countsS`: how
   * long each message counts, up to 10 [s]; without a newer one by then the axes stop, and the program ends. */
  servo(request: ServoRequest = {}, countsS = 0.1): Promise<Servo> { return Servo.open(this.gateway, this, request, countsS); }

  /**
   * Goes on with a program that has ended, such as by a restart of the server: energizes what it had, brings the axes to where its next line
   * starts, and runs the lines that the journal has. Lines behind `given` are to be sent where its text was not whole. What is not certain is
   * refused (MC450, MC592, MC593, MC594), and nothing moves.
   */
  continueProgram(request: ContinueRequest, options: ContinueOptions = {}): Promise<Program> {
    return Program.goOn(this.gateway, this, request, options);
  }

  /**
   * Moves an axis until the signal aborts; `velocity` is signed [mm/s, deg/s]. The server's dead man's time stops it when this
   * page, its link or the gateway dies.
   */
  async jogWhile(axis: number, velocity: number, signal: AbortSignal): Promise<void> {
    const program = await this.jog({ axis, velocity, hold_s: HOLD_S });
    try {
      while (!signal.aborted) {
        await pause(KEEP_MS, signal);
        if (!signal.aborted) await this.jog({ axis, velocity, hold_s: HOLD_S, program });
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
    let last = (await this.pastEvents({ since: 2 ** 52, limit: 1 })).newest;
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
        const page = await this.pastEvents({ since: last + 1, limit: 1000 });
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
