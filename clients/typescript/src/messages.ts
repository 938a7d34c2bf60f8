/** The messages of the key space (docs/schemas), as the gateway hands them on. Positions are in mm or deg. */

export type ProgramState =
  | "queued" | "running" | "held" | "paused" | "ending"
  | "finished" | "aborted" | "rejected" | "faulted" | "interrupted";

export const ENDED: ReadonlySet<string> = new Set(["finished", "aborted", "rejected", "faulted", "interrupted"]);

/** One fault of a program; columns are code points from 1, the end exclusive. */
export interface Diagnostic {
  code: string; message: string; line?: number; column?: number; end_column?: number; hint?: string; severity?: string;
}

export interface Fault { code: string; message: string; hint?: string; axis?: number | null; line?: number; }

export interface Ack {
  program: string; accepted: number; done: number; credit: number; state: ProgramState;
  rejected?: number; diagnostics?: Diagnostic[]; fault?: Fault | null; expected?: number;
  /** Of lines so far; an acknowledgement with a smaller count than one before is older. */
  rejections?: number;
}

export interface OpenReply { program: string; state: ProgramState; axes: number[]; expected: number; credit: number; instance: string; }

export interface SubmitReply { program: string; accepted: number; done: number; credit: number; rejections?: number; }

export interface ProgramStatus extends Ack {
  client: string; name: string; axes: number[]; line: number; closed: boolean; progress: number; eta_s?: number | null; duration_s?: number | null; notice?: string; simulated?: number; pauses?: number;
}

export interface AxesStatus {
  index: number[]; position: number[]; setpoint: number[]; velocity: number[]; torque: number[]; state: string[];
  homed?: boolean[];
}

export interface InputStatus { name: string; value: number; holds: boolean; stops: boolean; }

/** `set_by`: a program's id, "operator", or nobody (""). */
export interface OutputStatus { name: string; value: number; set_by: string; }

export interface ProbeStatus { program: string; line: number; tripped: boolean; positions: Record<string, number>; t: number; }

/** The origin of a work coordinate system such as G54: by axis number, mm or deg. */
export interface WorkOffset { system: string; origin: Record<string, number>; }

export interface MachineStatus {
  t: number; wall: number; instance: string; state: "ready" | "fault" | "estop"; axes: AxesStatus;
  programs: ProgramStatus[]; faults: Fault[]; override: number; late_cycles: number;
  probe?: ProbeStatus | null;
  inputs: InputStatus[]; outputs: OutputStatus[];
  work_offsets?: WorkOffset[];
}

export interface MotionEvent {
  seq: number; t: number; instance: string; kind: string;
  program?: string | null; client?: string | null; state?: string | null; message?: string; fault?: Fault | null;
  probe?: ProbeStatus | null;
}

export interface EventPage { instance: string; oldest: number; newest: number; events: MotionEvent[]; }

/** An input (`source`) or output (`target`, `min`, `max`, `safe`); what is left out has its default. */
export interface ChannelInfo {
  name: string; number: number; kind: "digital" | "analog"; unit?: string; source?: string; target?: string;
  hold?: boolean; stop?: boolean; min?: number; max?: number; safe?: number | null;
}

export interface Info {
  machine: string; server: string; protocol: number[]; instance: string; epoch: number; cycle_s: number;
  axes: { index: number; type: string; unit: string; max_velocity: number; homing?: string | null }[];
  telemetry: { axes: number[]; fields: string[]; cycles_a_message: number };
  limits: { max_line_length: number; max_lines_a_message: number; queue_lines: number };
  methods: string[]; inputs: ChannelInfo[]; outputs: ChannelInfo[];
}

export interface CheckResult { ok: boolean; diagnostics: Diagnostic[]; }

/** Some cycles of every axis: `fields` by name, each with `rows` x `axes.length` numbers, row by row. */
export interface Samples {
  seq: number; t: number; cycleS: number; rows: number; axes: number[]; fields: Record<string, Float32Array>;
}
