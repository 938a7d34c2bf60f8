import type { Connection } from "./connection.js";
import { type MotionError, NobodyAnswers, RequestRefused } from "./errors.js";
import type { OpenReply, ProgramState, ProgramStatus, ServoReply, ServoRequest } from "./messages.js";
import { type Behind, Program } from "./program.js";
import { understand } from "./wire.js";

/** The server acknowledges targets within 50 ms; one that has not for so long beyond what they count is gone. */
const UNANSWERED_S = 0.5;

/** Where the axes, or a tool, are to be; it replaces what was sent before. At least one of `positions` and `velocities`. */
export interface Targets {
  /** One number for each axis [mm, deg]; with `times` a row of them for each point. */
  positions?: number[] | number[][];
  /** [mm/s, deg/s]: with positions, the axes pass there at them; alone, they go on at them. */
  velocities?: number[] | number[][];
  /** Ascending [s from now], of the points. */
  times?: number[];
  /** As of `Machine.servo`. */
  countsS?: number;
  /** A tool's number: the rows are its poses X Y Z A B C and twists (X Y Z of one without orientation). */
  tool?: number;
  /** Whose axes a tool's velocities are along and about; poses are in the base's. Default `base`. */
  frame?: "base" | "tool";
}

/** Axes that follow what is sent, until `close` or `abort` (docs/servo.md). */
export class Servo {
  #seq = 0;

  private constructor(
    private readonly gateway: Connection, private readonly machine: Behind, private readonly program: Program,
    /** Rows of targets have one number for each, in this order. */
    readonly axes: number[],
    private readonly countsS: number, private readonly clock: () => number,
  ) {}

  /** Leases axes, energizes them and lets them follow; `clock`: the sender's time, which must not step [s]. */
  static async open(gateway: Connection, machine: Behind, request: ServoRequest, countsS: number, clock = (): number => performance.now() / 1000): Promise<Servo> {
    const opened = understand<ServoReply>("ServoReply", await machine.openServo(request));
    const running: OpenReply = { ...opened, state: "running", expected: 1, credit: 0, instance: "" };
    return new Servo(gateway, machine, await Program.follow(gateway, machine, running), opened.axes, countsS, clock);
  }

  /** Of the program that follows. */
  get id(): string { return this.program.id; }
  get state(): ProgramState { return this.program.state; }
  /** What `send` and `close` will fail with, as soon as it is known: ProgramEnded where nothing came in time, or somebody stopped it. */
  get failure(): MotionError | null { return this.program.failure; }

  /**
   * Sends targets, without waiting: what the connection cannot take now is lost, for the next ones are newer. Throws once the program has
   * ended: ProgramEnded as of `failure`, MC536 after `close`; NobodyAnswers (MC530) where the server has not answered for as long as targets
   * count, and 0.5 s.
   */
  send(targets: Targets): void {
    if (this.failure) throw this.failure;
    if (this.program.ended) throw new RequestRefused("MC536", `the program takes no more targets: it is ${this.state}`, "open another one");
    const now = this.clock(), countsS = targets.countsS ?? this.countsS;
    // a sender that stood still for longer has not listened meanwhile
    if (this.program.asked !== null) this.program.silentS += Math.min(now - this.program.asked, UNANSWERED_S);
    this.program.asked = now;
    if (this.program.silentS > countsS + UNANSWERED_S) {
      throw new NobodyAnswers("MC530", `the server has not answered for ${this.program.silentS.toFixed(1)} s`, "where it is gone the axes have stopped: once it is there, open servo mode anew");
    }
    const message = [
      ++this.#seq, now, countsS, rows(targets.positions), rows(targets.velocities), targets.times ?? null,
      targets.tool ?? null, targets.frame ?? "base",
    ];
    this.gateway.put({ op: "targets", machine: this.machine.name, program: this.id, message });
  }

  /** The program; its `servo` counts what was late, lost or dropped. */
  async status(): Promise<ProgramStatus> {
    return understand<ProgramStatus>("ProgramStatus", (await this.machine.programs({ program: this.id }))[0]);
  }

  /** Lets the axes go on to the last targets, and resolves once they stand there. Rejects as the program ended otherwise. */
  close(): Promise<void> { return this.program.finish(); }

  /** Stops the axes within their limits now. */
  async abort(): Promise<void> { await this.program.abort(); }
}

/** One row for each point. */
function rows(values: number[] | number[][] | undefined): number[][] | null {
  if (values === undefined) return null;
  return Array.isArray(values[0]) ? values as number[][] : [values as number[]];
}
