// Made by `python -m mcserver.contract.sdk clients`: change the server's messages instead.

/**
 * The messages of the key space (docs/schemas), as the gateway hands them on.
 * Positions are in mm or deg. What may be left out has its default there; null: none.
 */

export const ENDED: ReadonlySet<string> =
  new Set(["finished", "aborted", "rejected", "faulted", "interrupted"]);

export type AxisKind =
  | "linear" | "rotary";

export type AxisState =
  | "off" | "starting" | "standstill" | "moving" | "speed" | "torque" | "stopping" | "released" | "fault";

export type AxisUnit =
  | "mm" | "deg";

export type BedMeshState =
  | "off" | "file" | "probed";

export type ChannelKind =
  | "digital" | "analog";

export type DrivePhase =
  | "booting" | "operational" | "lost" | "restarting" | "failed" | "closed";

export type EventKind =
  | "server.started" | "server.stopping" | "program.opened" | "program.started" | "program.held" | "program.resumed"
  | "program.paused" | "program.message" | "program.closed" | "input.read" | "program.ended" | "lines.started"
  | "lines.ended" | "line.rejected" | "fault" | "warning" | "estop" | "reset" | "override" | "command" | "client.gone"
  | "recording" | "axis.homing" | "axis.homed" | "axis.unhomed" | "probe" | "drive.emergency" | "drive.lost"
  | "drive.back" | "drive.rebooted" | "drive.started" | "drive.failed" | "bus.foreign_master" | "bus.lost"
  | "bus.back";

export type Fieldbus =
  | "can" | "ethercat";

export type ToolFrame =
  | "base" | "tool";

export type LoopMode =
  | "cst" | "csv";

export type MachineState =
  | "ready" | "fault" | "estop";

export type OnDisconnect =
  | "finish" | "stop";

export type Outputs =
  | "set" | "leave";

export type ProgramState =
  | "queued" | "running" | "held" | "paused" | "ending" | "finished" | "aborted" | "rejected" | "faulted"
  | "interrupted";

export type Quantity =
  | "end" | "position" | "travel" | "speed" | "duration" | "clearance";

export type RecordingKind =
  | "recording" | "blackbox";

export type RecordingState =
  | "writing" | "done" | "unfinished";

export type RunRole =
  | "agent" | "operator";

export type RunState =
  | "waiting" | "armed" | "started" | "rejected";

export type SdoType =
  | "bool" | "i8" | "i16" | "i24" | "i32" | "i64" | "u8" | "u16" | "u24" | "u32" | "u64" | "f32" | "f64" | "str"
  | "utf16" | "bytes";

export type Severity =
  | "error" | "warning";

export type ToolDirection =
  | "X" | "Y" | "Z" | "A" | "B" | "C";

/** Payload of `ack/{program}`: cumulative, so a lost one does not matter. */
export interface Ack {
  program: string;
  /** lines through this number are accepted and journaled. */
  accepted: number;
  /**
   * this line and every one before it have ended: their setpoints have been passed, and after an exact stop the
   * axes are in position. Between exact stops an axis may lag by its following error, at most
   * `max_following_error`: a stricter condition would make each line a stop.
   */
  done: number;
  /** how many lines after `accepted` fit now. */
  credit: number;
  /** the program's. */
  state: ProgramState;
  /** number of the line that was found faulty; it is the next one expected. 0: none. */
  rejected?: number;
  /** what is wrong with it. */
  diagnostics?: Diagnostic[];
  /** what stopped the program. */
  fault?: Fault | null;
  /** the line number expected, set if the acknowledged message left a gap. */
  expected?: number;
  /**
   * how many lines of the program have been rejected so far. An acknowledgement with a smaller count than an
   * earlier one is older: its numbers are of lines that were discarded.
   */
  rejections?: number;
  /** why it was aborted: by whom, or a code; empty in programs of an earlier start of the server. */
  reason?: string;
}

/** A number that a button asks for, in the units of its text; `first` is shown first. */
export interface ArgumentInfo {
  name: string;
  low: number;
  high: number;
  first: number;
  unit: string;
}

/** Arms a text once. */
export interface ArmRequest {
  /** of the text, or at least its first 8 digits. */
  sha256: string;
  /** how long it may be started. */
  seconds?: number | undefined;
  /** the greatest feed override [%]. */
  override?: number | undefined;
  /** of the request that was reviewed: one that was repeated since is not armed; null: any. */
  number?: number | null | undefined;
  /**
   * for this time every other run that the same client requests, and that stays inside the envelope of this run,
   * is armed at its request; 0: only this run, once.
   */
  standing_s?: number | undefined;
  /**
   * for the same time it may also stream targets, inside the extents, speeds and duration of this run
   * (`servo_armed`); no simulation shows these beforehand.
   */
  servo?: boolean | undefined;
}

/** One bound of a run. */
export interface Assertion {
  /**
   * `end`: where a coordinate ends; `position`: where it is at any time; `travel`: how far its greatest place is
   * from its least; `speed`: of an axis, or of a tool's tip (`T3`); `duration` [s]; `clearance`: the least
   * between bodies [mm].
   */
  what: Quantity;
  /** the coordinate: `X`, `7`, `T3.X`; a speed's axis or tool; empty for duration and clearance. */
  of?: string;
  /** bounds, which belong to it [mm or deg, per second]; null: none to this side. */
  least?: number | null;
  /** bounds, which belong to it [mm or deg, per second]; null: none to this side. */
  most?: number | null;
}

/** All axes, column-wise: every list has one entry for each of `index`. */
export interface AxesStatus {
  index: number[];
  position: number[];
  setpoint: number[];
  velocity: number[];
  torque: number[];
  state: AxisState[];
  /** whether the axis knows its position; axes without `[axis.homing]` always do. */
  homed?: boolean[];
  /**
   * how much the second drive of a gantry pair is further than its leader [mm, deg]; 0 for other axes. Empty on a
   * machine without pairs.
   */
  skew?: number[];
  /** whether the axis's drive does not answer: its position, velocity and torque are old. Empty while all answer. */
  silent?: boolean[];
}

/** How an axis moves otherwise; the other program's minus this one's [mm or deg]. */
export interface AxisDifference {
  axis: number;
  unit: string;
  /** greatest difference of two setpoints of the same cycle; the shorter run rests at its end. */
  most: number;
  /** when, and the lines that run then. */
  time_s: number;
  /** when, and the lines that run then. */
  line: number;
  /** when, and the lines that run then. */
  other_line: number;
  /** differences of the least, greatest and last setpoint. */
  min: number;
  /** differences of the least, greatest and last setpoint. */
  max: number;
  /** differences of the least, greatest and last setpoint. */
  end: number;
}

/**
 * One axis; limits in mm or deg and seconds, null where not limited. `homing`: how it finds its reference; null:
 * its encoder's reading is its position. `letter`: an additional letter by which programs of the machine's
 * profile name it, such as `E`; empty: none. `spindle`: M3, M4, M5 and S turn it.
 */
export interface AxisInfo {
  index: number;
  type: AxisKind;
  unit: AxisUnit;
  max_velocity: number;
  max_acceleration: number;
  drive: string;
  max_jerk?: number | null;
  min_position?: number | null;
  max_position?: number | null;
  in_position?: number;
  homing?: string | null;
  letter?: string;
  spindle?: boolean;
}

/** An axis of a program that is to start at a line. */
export interface AxisStart {
  axis: number;
  unit: string;
  /** present position [mm, deg]. */
  now: number;
  /** position in the program before the line [mm, deg]; null: unknown. */
  there: number | null;
  /** the axis is energized in the program there. */
  energized: boolean;
  /** the two positions differ by more than the axis's in-position tolerance, or `there` is unknown. */
  away: boolean;
}

/** Where an axis ends, and its least and greatest setpoint [mm or deg]. */
export interface AxisTravel {
  position: number;
  min: number;
  max: number;
  unit: string;
}

/** Frames that were counted while a bus was listened to. */
export interface BusCounts {
  /** how long the bus was listened to [s]. */
  duration_s: number;
  /** number of all frames. */
  frames: number;
  /** share of the bit rate that they took [1], each counted with the most stuff bits that it can have. */
  load: number;
  /** number of SYNCs. */
  syncs?: number;
  /** longest time between two of them, by this computer's clock [s]. */
  longest_sync_gap_s?: number;
  nodes?: NodeHealth[];
  /** number of frames by COB-ID, of COB-IDs that belong to no node of the machine file. */
  strangers?: Record<string, number>;
}

/** Result of listening to a bus beside its master. */
export interface BusHealth {
  bus: string;
  /** numbers of frames; on EtherCAT a node is a position on the line. */
  counts: BusCounts;
  /** the sign by which a master was noticed; empty: none was. */
  master?: string;
  /**
   * number of errors and malformed packets at this computer's interface, on EtherCAT of frames with a wrong
   * working counter.
   */
  error_frames?: number;
  /** greatest following error by axis, between setpoint and encoder on the bus [mm, deg]. */
  following_errors?: Record<string, number>;
}

/** The nodes that answer on a bus. */
export interface BusScan {
  bus: string;
  address: string;
  nodes: ScannedNode[];
  /** text of a machine file with these drives, to start from. */
  machine_file: string;
  /** kind of the bus. */
  fieldbus?: Fieldbus;
}

/** A program of the machine file, or a probing cycle, that people start from a page. */
export interface ButtonInfo {
  name: string;
  /** lines of G-code; `{name}` is the place of an argument. */
  text: string;
  /** the lowest role that may press it, `operator` or `engineer`. */
  role: string;
  /** what must be confirmed before it runs; empty: nothing. */
  confirm: string;
  arguments: ArgumentInfo[];
  /** the heading under which pages show it. */
  group: string;
}

/** As `mcserver check --json`. */
export interface CheckReply {
  ok: boolean;
  diagnostics: Diagnostic[];
}

/** Every fault of a program's text; nothing runs. */
export interface CheckRequest {
  /** the whole text; or sha256: of one that was uploaded by `put_text`. */
  text?: string | null | undefined;
  /** start the axes there [mm, deg]. */
  positions?: Record<string, number> | null | undefined;
  sha256?: string | null | undefined;
  /** as of `OpenRequest`. */
  block_delete?: boolean | null | undefined;
  /** as of `OpenRequest`. */
  optional_stop?: boolean | null | undefined;
}

/** The least distances of a run's bodies. */
export interface ClearanceReport {
  margin_mm: number;
  /** null if all stayed apart by more than the margin plus 50 mm. */
  least_mm: number | null;
  /** that came nearer, the nearest first, 20 at most. */
  pairs: PairClearance[];
  /** zones that an input switches, which count as on. */
  assumed_on?: string[];
}

/** `accepted`: the last line that will run. */
export interface CloseReply {
  program: string;
  accepted: number;
  done: number;
  state: ProgramState;
}

/**
 * No more lines will come; the accepted lines run to their end. `last`: the last line that was sent; the program
 * is only closed if it has been accepted.
 */
export interface CloseRequest {
  program: string;
  last?: number | null | undefined;
}

/** How a program would continue. */
export interface Continuation {
  /** its id, empty for a text. */
  program: string;
  /** as it ended; lines through `done` are certain. */
  name: string;
  /** as it ended; lines through `done` are certain. */
  state: ProgramState | null;
  /** as it ended; lines through `done` are certain. */
  done: number;
  /** as it ended; lines through `done` are certain. */
  accepted: number;
  /** its text is known to its end, so nothing must be sent. */
  whole: boolean;
  /** of its whole text. */
  sha256: string | null;
  /** the first that would run. */
  line: number;
  /** of the text around that line. */
  first: number;
  /** of the text around that line. */
  lines: string[];
  /** codes in force there. */
  modal: string[];
  /** axes that are energized first. */
  energize: number[];
  /** where each is, and where the program has it there. */
  axes: AxisStart[];
  /** the moves that bring them there, in order. */
  way: WayStep[];
  /** what the program had switched differently from now. */
  switched: Switched[];
  /** what prevents it; one that has `confirm` is met by that field of the request. */
  needs: Need[];
  /** the settings that it continues with. */
  block_delete: boolean;
  /** the settings that it continues with. */
  optional_stop: boolean;
}

/** What a start in the middle of a program would do; nothing moves. */
export interface ContinuationRequest {
  /** one that has ended; if others have continued it, the last of these is meant. */
  program?: string | null | undefined;
  /** the first that would run; null: the one after the last that is done. */
  line?: number | null | undefined;
  /** lines 1 … line - 1 of a text, instead of `program`. */
  before?: string[] | undefined;
  /** of it; null: all of the machine. */
  axes?: number[] | null | undefined;
  /** of the text, as in `OpenRequest`; a program keeps its settings. */
  block_delete?: boolean | null | undefined;
  /** of the text, as in `OpenRequest`; a program keeps its settings. */
  optional_stop?: boolean | null | undefined;
}

/** The program that continues, like `OpenReply`. */
export interface ContinueReply {
  program: string;
  state: ProgramState;
  axes: number[];
  expected: number;
  credit: number;
  instance: string;
  /** the first that runs. */
  line: number;
  /** the program that it continues. */
  resume_of: string;
  /** the server has all of its lines; otherwise the client sends those from `expected` on. */
  whole: boolean;
}

/** Continues a program that has ended. */
export interface ContinueRequest {
  /** as in `ContinuationRequest`. */
  program: string;
  /** as in `ContinuationRequest`. */
  line?: number | null | undefined;
  /** axes may move as `continuation` shows, if the machine file names no safe way. */
  way?: boolean | undefined;
  /** set what the program had switched, or leave it as it is; null: not specified. */
  outputs?: Outputs | null | undefined;
  /** as in `OpenRequest`. */
  on_disconnect?: OnDisconnect | undefined;
  /** as in `OpenRequest`. */
  grace_s?: number | undefined;
  /** begin held. */
  hold?: boolean | undefined;
}

/** How another program moves. */
export interface Difference {
  /** every setpoint is the same to the bit. */
  same: boolean;
  /** the other one's minus this one's. */
  duration_s: number;
  /** those whose setpoints differ. */
  axes: AxisDifference[];
  /** all. */
  tips: TipDifference[];
}

/** How slow the disk under the journal is. */
export interface DiskStatus {
  /** Unix time from which on it is slow [s]. */
  since: number;
  /** how long messages have waited for the journal's commit [s]. */
  commit_s: number;
  /** how long the current sync has taken [s]; a power cut loses what was committed in that time. */
  sync_s: number;
  /** the longest of these since then [s]. */
  worst_s: number;
}

/** Reply of methods that return no data: the programs concerned. */
export interface Done {
  programs: string[];
}

/** A drive on a bus and its state. */
export interface DriveInfo {
  axis: number;
  kind: string;
  bus: string;
  /** node number; on EtherCAT the position on the line. */
  node: number;
  /** state of the drive in the server's supervision. */
  state: DrivePhase;
  /** NMT state in the last heartbeat, on EtherCAT the AL state; empty: no heartbeat has come yet. */
  nmt?: string;
  /** time since the last sign of life [s]; null: none has come yet. */
  heartbeat_age_s?: number | null;
  /** 6041h; of a drive that streams telemetry its fault bits. */
  statusword?: number | null;
  /** the same in words. */
  status?: string;
  /** objects 1000h, 1018h:01 and 1018h:02. */
  device_type?: number | null;
  /** objects 1000h, 1018h:01 and 1018h:02. */
  vendor_id?: number | null;
  /** objects 1000h, 1018h:01 and 1018h:02. */
  product_code?: number | null;
  /** the last emergency message in words, on EtherCAT the error code 603Fh. */
  emergency?: string;
  /** its error code. */
  emergency_code?: number | null;
  /** time since it came [s]. */
  emergency_age_s?: number | null;
  /** number of the drive's starts since the server started. */
  boot_ups?: number;
  /** why the last configuration failed. */
  message?: string;
  /** newest values of its telemetry, and of objects that `monitor` in the machine file names. */
  monitor?: MonitoredValue[];
  /** kind of the bus. */
  fieldbus?: Fieldbus;
}

/** The objects of a drive, of one axis of its node. */
export interface DriveParameters {
  axis: number;
  bus: string;
  /** node number; on EtherCAT the position on the line. */
  node: number;
  /** number of the axis among those of its node, from 0. */
  node_axis: number;
  /** digest of the drive's EDS; empty: it has none, and the objects are those of the standard. */
  eds_sha256: string;
  parameters: ParameterInfo[];
  /** entries of the EDS that cannot be read, each with the reason. */
  unreadable: string[];
  /** kind of the bus. */
  fieldbus?: Fieldbus;
}

/** The objects of an axis's drive. */
export interface DriveParametersRequest {
  axis: number;
}

/** Every mapped object of an axis's drive in each cycle. */
export interface DriveScopeRequest {
  axis: number;
  /** time kept. */
  seconds?: number | undefined;
  /** such as `following error > 0.05`; empty: at once. */
  trigger?: string | undefined;
  /** fires also if the level is already met. */
  level?: boolean | undefined;
  /** kept before the trigger; null: a quarter. */
  before_s?: number | null | undefined;
  /** how long the trigger may take. */
  timeout_s?: number | undefined;
}

/** Recording of every mapped object of an axis in each cycle, around a trigger. */
export interface DriveTrace {
  axis: number;
  /** number of cycles. */
  cycles: number;
  /** length of a cycle [s]. */
  cycle_s: number;
  /** time of the first cycle; the trigger is at time 0 [s]. */
  begin_s: number;
  /** Unix time of time 0 [s]. */
  trigger_unix: number;
  /** number of SYNCs that are missing in the recording. */
  missing: number;
  signals: ScopeSignal[];
}

/** The gains of an axis in mode cst or csv, by the motion of a program; `seconds`: time observed. */
export interface DriveTuneRequest {
  axis: number;
  seconds?: number | undefined;
}

/** Result of measuring an axis in mode cst or csv while it moves, and proposed gains of its loop. */
export interface DriveTuning {
  axis: number;
  mode: LoopMode;
  /**
   * in mode cst inertia [kg·m²], friction [N·m], viscous [N·m·s/rad], load [N·m], explained and uncertainty [1];
   * in mode csv scale [1], lag and uncertainty [s].
   */
  measured: Record<string, number>;
  /** the same in words. */
  said: string;
  /** the loop with the gains of the machine file, then with the proposed ones. */
  loops: TunedLoop[];
  /** lines to change in the machine file; empty: its gains fit. */
  changes: string[];
  /** how to apply the changes. */
  remedy: string;
  /** open-loop response with the gains of the machine file, as measured; empty: not known. */
  frequency_hz: number[];
  /** open-loop response with the gains of the machine file, as measured; empty: not known. */
  gain_db: number[];
  /** open-loop response with the gains of the machine file, as measured; empty: not known. */
  phase_deg: number[];
}

/** By bus. */
export interface DrivesHealthReply {
  buses: BusHealth[];
}

/** Health of the buses; `seconds`: how long to listen to them, all together. */
export interface DrivesHealthRequest {
  seconds?: number | undefined;
}

/** By axis; empty if no drive is on a bus. */
export interface DrivesReply {
  drives: DriveInfo[];
}

/** Every drive on a bus. */
export interface DrivesRequest {
}

/** By bus; each with a machine file to start from. */
export interface DrivesScanReply {
  buses: BusScan[];
}

/** Scans a bus: every node number of CAN, every drive of EtherCAT; `bus` empty: all buses. */
export interface DrivesScanRequest {
  bus?: string | undefined;
}

/** A certain remedy: characters of the diagnostic's line and what replaces them. */
export interface Edit {
  /** code points from 1, end exclusive. */
  column: number;
  /** code points from 1, end exclusive. */
  end_column: number;
  /** the replacement. */
  text: string;
}

/** Payload of every `reply_err`. */
export interface ErrorReply {
  code: string;
  message: string;
  hint?: string;
  /** what the code's entry in docs/wire/errors.md lists, such as `expected`. */
  details?: Record<string, unknown>;
  /** faults of G-code, if the error concerns lines. */
  diagnostics?: Diagnostic[];
}

/** Emergency stop by rpc, and payload of the key `estop` (where it may be empty). */
export interface EstopRequest {
  /** for people. */
  reason?: string | undefined;
  /** on the key `estop`, who stops, by its own account; a call has it in its key. */
  client?: string | undefined;
}

/** Payload of `event`; `seq` has no gap within one `instance`. Times `t` of two instances cannot be compared. */
export interface MotionEvent {
  seq: number;
  /** executor time [s]. */
  t: number;
  instance: string;
  /** determines which of the others are set (docs/wire/events.md). */
  kind: EventKind;
  program?: string | null;
  client?: string | null;
  state?: ProgramState | null;
  /** the last line started for `lines.started`; the line of a fault. */
  line?: number;
  /** for `lines.ended`. */
  lines?: LineReport[];
  fault?: Fault | null;
  diagnostics?: Diagnostic[];
  /** why a program ended, an emergency stop's reason, a warning's code, a drive's or bus's code. */
  reason?: string;
  message?: string;
  percent?: number | null;
  /** of a drive's event, or of homing. */
  axis?: number | null;
  /** for `probe`. */
  probe?: ProbeStatus | null;
  /** Unix time of `t`, by the clock as it went then [s]. */
  wall?: number;
}

/** `oldest` is the first number that the server still holds; `newest` the last one published. */
export interface EventsReply {
  instance: string;
  oldest: number;
  newest: number;
  events: MotionEvent[];
}

/** Events that the server still holds, from number `since` on, oldest first. */
export interface EventsRequest {
  since?: number | undefined;
  limit?: number | undefined;
}

/** Least and greatest setpoint of an axis [mm or deg], and its greatest speed [mm/s or deg/s]. */
export interface Extent {
  axis: number;
  low: number;
  high: number;
  unit: string;
  speed?: number;
  /** the axis turns continuously at a speed (G1030): its positions are not bounded. */
  turns?: boolean;
}

/** What stopped motion: a stable code, and the axis and line if they apply. */
export interface Fault {
  code: string;
  message: string;
  hint?: string;
  axis?: number | null;
  line?: number;
  program?: string | null;
  t?: number;
}

/** The program that homes, for `abort`, and its axes in the order of their homing. */
export interface HomeReply {
  program: string;
  axes: number[];
}

/** Finds the references of axes, those with the lowest order first; null: of all that have a method. */
export interface HomeRequest {
  axes?: number[] | null | undefined;
}

/** Reply of `info`. */
export interface Info {
  machine: string;
  server: string;
  /** versions of this key space that the server speaks. */
  protocol: number[];
  /** one start of the server; a different one means that earlier programs were interrupted. */
  instance: string;
  /** Unix time of executor time 0, by the clock as it goes now [s]. */
  epoch: number;
  cycle_s: number;
  axes: AxisInfo[];
  tools: ToolInfo[];
  telemetry: TelemetryInfo;
  limits: LimitsInfo;
  methods: string[];
  inputs?: InputInfo[];
  outputs?: OutputInfo[];
  /** programs of the machine file that operators start, with places for numbers. */
  buttons?: ButtonInfo[];
  /** by which people find the machine. */
  group?: string;
  /** by which people find the machine. */
  tags?: string[];
  /** address of a still picture or of MJPEG; empty: none. */
  camera?: string;
  /** instruments that may command, such as `opcua`; others only show the machine. */
  orders_from?: string[];
}

/** What the machine and its service are: an `Info`. */
export interface InfoRequest {
}

/** One input. */
export interface InputInfo {
  name: string;
  /** within its kind, as M66 names it. */
  number: number;
  kind: ChannelKind;
  unit?: string;
  /** of a real input; empty: it is simulated. */
  source?: string;
  /** it can hold the programs, or stop the machine. */
  hold?: boolean;
  /** it can hold the programs, or stop the machine. */
  stop?: boolean;
}

/** An input: its value (digital: 0, 1), and whether it holds the programs or stops the machine now. */
export interface InputStatus {
  name: string;
  value: number;
  holds?: boolean;
  stops?: boolean;
}

/** The jog's program id: for `abort`, and for keeping it alive. */
export interface JogReply {
  program: string;
}

/** Moves one axis by hand. */
export interface JogRequest {
  axis: number;
  /** from where it is, signed [mm, deg]; null: until stopped or the limit, by the sign of `velocity`. */
  distance?: number | null | undefined;
  /** [mm/s, deg/s]; null: a tenth of the axis's limit. */
  velocity?: number | null | undefined;
  /**
   * dead-man timeout: the axis stops unless the same jog is requested again within it; null: no timeout. A jog
   * without distance always has one (default 0.5 s).
   */
  hold_s?: number | null | undefined;
  /** id of the running jog that this request keeps alive. */
  program?: string | null | undefined;
  /**
   * the person, if a client serves several: steps of one person follow each other, those of another person are
   * refused (MC512) while the axis moves.
   */
  by?: string | undefined;
}

/** An assertion as the run keeps to it. */
export interface Judged {
  /** of the assertion. */
  what: Quantity;
  /** of the assertion. */
  of: string;
  /** of the assertion. */
  least: number | null;
  /** of the assertion. */
  most: number | null;
  /** whether the run keeps to it. */
  holds: boolean;
  /** the extreme that counts; null: bodies stay farther apart than is reported. */
  value: number | null;
  /** when and in which line it has this value, or leaves the bounds of a position or speed. */
  time_s: number;
  /** when and in which line it has this value, or leaves the bounds of a position or speed. */
  line: number;
}

/** The client leaves: its open programs end now as their `on_disconnect` says, without a grace time. */
export interface LeaveRequest {
}

/** Bounds of the service. */
export interface LimitsInfo {
  max_line_length: number;
  max_lines_a_message: number;
  queue_lines: number;
  programs_at_once: number;
  open_programs: number;
  remembered_answers: number;
  remembered_answer_s: number;
}

/** Time of one line that has ended. */
export interface LineReport {
  line: number;
  /** executor time [s]. */
  start_s: number;
  /** executor time [s]. */
  end_s: number;
  /** null if the line requests no time. */
  requested_s?: number | null;
  /** actual / requested; null without a requested time. */
  stretched_by?: number | null;
  /** the limit that stretched it, such as `axis 2 acceleration`. */
  bound_by?: string | null;
}

export interface MachineFileReply {
  /** of the file, without its folder. */
  name: string;
  /** as it is on the disk now. */
  text: string;
  /** of that text. */
  sha256: string;
  /** the server runs with this text; otherwise it has changed since the start. */
  in_force: boolean;
}

/** The machine file that the server was started with. */
export interface MachineFileRequest {
}

/** Payload of `tele/state` and reply of `status`. */
export interface MachineStatus {
  /** executor time [s]. */
  t: number;
  /** Unix time of `t` [s]. */
  wall: number;
  instance: string;
  state: MachineState;
  axes: AxesStatus;
  programs: ProgramStatus[];
  faults: Fault[];
  /** machine-wide feed override [%]. */
  override?: number;
  /** cycles that began too late, since the start. */
  late_cycles?: number;
  tools?: ToolPose[];
  /** those of the machine file, in the order of `info`. */
  inputs?: InputStatus[];
  /** those of the machine file, in the order of `info`. */
  outputs?: OutputStatus[];
  probe?: ProbeStatus | null;
  /** systems that were set, with which the next program starts (G54 is in force then). */
  work_offsets?: WorkOffset[];
  /** how slow the disk under the journal is; null: it keeps up. */
  disk?: DiskStatus | null;
  /** tools that have bodies and are known to be mounted. */
  mounted?: MountedTool[];
  /**
   * mesh in force where G29 probes one: none, that of the machine file, or the probed one; null: G29 does not
   * probe.
   */
  bed_mesh?: BedMeshState | null;
}

/** A mesh that the URDF names: `name` as written there; `size` in bytes, 0: it is not available. */
export interface MeshInfo {
  name: string;
  size: number;
}

/** A body or zone of `[clearance]`. */
export interface ModelBody {
  name: string;
  /** `box` (of a zone too), `cylinder`, `capsule`, `sphere`, `mesh` or `cutter`. */
  shape: string;
  /** edges of a box, radius and length of a round shape. */
  size_mm: number[];
  /** in the frame of its carrier, Rz(C)·Ry(B)·Rx(A). */
  at_mm: number[];
  /** in the frame of its carrier, Rz(C)·Ry(B)·Rx(A). */
  turned_deg: number[];
  /** its index in `ModelReply.meshes`; the file is in mm. */
  mesh?: number | null;
  /** of the URDF that carries it. */
  link?: string;
  /** axes that carry it instead */
  carried_by?: number[];
  /** of these, 0 to 2 for X to Z. */
  directions?: number[];
  /** in their negative direction. Neither: it is fixed. */
  opposite?: boolean;
  /** with which it is mounted; null: it is always there. */
  tool?: number | null;
  /** `keep_out`, `keep_in` or `slow`; empty: a body. */
  zone?: string;
  /** name of the input that switches it on; empty: it is always on. */
  input?: string;
  /** the input's level then. */
  high?: boolean;
}

/** Part of a mesh's file: `mesh` counts from 0 in `ModelReply.meshes`. */
export interface ModelMeshRequest {
  mesh: number;
  offset?: number | undefined;
  size?: number | undefined;
}

/** `data` from `offset` on; `size` of the whole file. */
export interface ModelPart {
  offset: number;
  size: number;
  data: Uint8Array;
}

/** A robot's URDF, and the bodies and zones of a machine. */
export interface ModelReply {
  /** its text; empty: the machine has none. */
  urdf: string;
  /** of the text and the meshes. */
  digest: string;
  /** the joint that each axis moves, by axis number. */
  joints: Record<string, string>;
  /** of the visuals, followed by those of bodies, in the order of `ModelMeshRequest.mesh`. */
  meshes: MeshInfo[];
  bodies?: ModelBody[];
}

/** What the machine looks like: a `ModelReply`. */
export interface ModelRequest {
}

/** A value of a drive: of an object that `monitor` in the machine file names, or of its own telemetry. */
export interface MonitoredValue {
  name: string;
  /** the newest one; null: none has come yet. */
  value: boolean | number | string | null;
  /** the object; index 0: it is telemetry. */
  index?: number;
  /** the object; index 0: it is telemetry. */
  subindex?: number;
}

/** A tool that has a body and is mounted, according to a program. */
export interface MountedTool {
  number: number;
  /** it is the cutter in the spindle, with `length` and `diameter` of the tool table [mm]; otherwise both are 0. */
  spindle: boolean;
  length: number;
  diameter: number;
}

/** What has to be resolved before a program starts at a line: code, message and remedy. */
export interface Need {
  code: string;
  message: string;
  hint: string;
  /** field of the request that confirms it, `way` or `outputs`; empty: it cannot be confirmed. */
  confirm?: string;
}

/** Frames of a node that were counted while a bus was listened to. */
export interface NodeHealth {
  node: number;
  /** numbers of the machine's axes that the node has. */
  axes: number[];
  /** NMT state in the last heartbeat; empty: none came. */
  state?: string;
  /** number of heartbeats. */
  heartbeats?: number;
  /** longest time between two of them, by this computer's clock [s]. */
  longest_gap_s?: number;
  /** number of TPDOs that the node sends at SYNC. */
  readings?: number;
  /** number of those that came after the next SYNC. */
  late?: number;
  /** number of those that never came. */
  lost?: number;
  /** number of its boot-up messages. */
  boot_ups?: number;
  /** its last emergency messages in words. */
  emergencies?: string[];
}

/** The program's id; `expected` is the next line number, `credit` how many lines fit now. */
export interface OpenReply {
  program: string;
  state: ProgramState;
  axes: number[];
  expected: number;
  credit: number;
  instance: string;
}

/** Opens a program. */
export interface OpenRequest {
  /** for people: a file's name. */
  name?: string | undefined;
  /** the axes to lease; null: all of the machine. */
  axes?: number[] | null | undefined;
  /** what happens when the client's liveliness token disappears, or it calls `leave`. */
  on_disconnect?: OnDisconnect | undefined;
  /** how long the token may be absent before that; a client that returns in this time continues. */
  grace_s?: number | undefined;
  /** number of the first line that will run. */
  start_line?: number | undefined;
  /**
   * lines 1 … start_line - 1. They do not run; the axes move to where these lines end, energized, in the modal
   * state that they leave.
   */
  before?: string[] | undefined;
  /** id of an earlier program; its journaled lines before `start_line` serve as `before`. */
  resume_of?: string | null | undefined;
  /** single-line mode: a line starts only on a `step` call. */
  step?: boolean | undefined;
  /** begin held; `resume` starts it. */
  hold?: boolean | undefined;
  /** of the whole text; its times, from `simulate` or `put_text`, are used for the program. */
  sha256?: string | null | undefined;
  /**
   * run now, also on axes of a program that is at a pause, such as to set zero with a new tool; refused (MC512)
   * if it would have to wait. Without it a program waits for the other's end.
   */
  at_pause?: boolean | undefined;
  /** of a start in the middle, as in `ContinueRequest`. */
  way?: boolean | undefined;
  /** of a start in the middle, as in `ContinueRequest`. */
  outputs?: Outputs | null | undefined;
  /**
   * lines that begin with `/` are skipped, until the program ends; null: they are executed as if it were not
   * there, but `resume_of` keeps its setting (D-98).
   */
  block_delete?: boolean | null | undefined;
  /** whether M01 pauses; null: it does, but `resume_of` keeps its setting. */
  optional_stop?: boolean | null | undefined;
}

/** One output. */
export interface OutputInfo {
  name: string;
  /** within its kind, as M62 to M68 name it. */
  number: number;
  kind: ChannelKind;
  unit?: string;
  /** of a real output; empty: it is simulated. */
  target?: string;
  /** least and greatest value. */
  min?: number;
  /** least and greatest value. */
  max?: number;
  /** its value once its setter is lost; null: it stays. */
  safe?: number | null;
}

/** An output: its value (digital: 0, 1), and who set it last: a program's id, `operator` or nobody (empty). */
export interface OutputStatus {
  name: string;
  value: number;
  set_by?: string;
}

/** The override now in force [%]. */
export interface OverrideReply {
  percent: number;
  programs: string[];
}

/** Feed override of one program or of all, including future ones; 100 is as programmed. */
export interface OverrideRequest {
  percent: number;
  program?: string | null | undefined;
}

/** How near two `bodies` came to each other, when, and in which line. */
export interface PairClearance {
  bodies: string[];
  least_mm: number;
  time_s: number;
  line: number;
}

/** An object of a drive, as its EDS describes it. */
export interface ParameterInfo {
  index: number;
  subindex: number;
  /** name in the EDS; a member's follows that of its record: `Gear ratio.Motor revolutions`. */
  name: string;
  /** data type. */
  type: SdoType;
  /** ro, wo, rw, rwr, rww or const. */
  access: string;
  /** limits in the EDS; null: the limits of the type. */
  low?: number | null;
  /** limits in the EDS; null: the limits of the type. */
  high?: number | null;
}

/** The last probing move that has ended (G38.2 to G38.5). */
export interface ProbeStatus {
  program: string;
  line: number;
  /** the probe changed. */
  tripped: boolean;
  /**
   * where the axes were then, else where the move ended, by number [mm, deg]: machine positions, independent of
   * the program's offsets.
   */
  positions: Record<string, number>;
  /** executor time [s]. */
  t: number;
}

/** hold, resume, abort: one program, or every one (null). */
export interface ProgramRequest {
  program?: string | null | undefined;
}

/** One program. */
export interface ProgramStatus {
  program: string;
  state: ProgramState;
  client: string;
  name: string;
  axes: number[];
  start_line: number;
  /** the line being run, at a pause the one that asks for it; 0: none yet. */
  line: number;
  accepted: number;
  done: number;
  credit: number;
  closed: boolean;
  override: number;
  /** share of its time that has passed, 0 … 1; if `duration_s` is unknown, of its lines. */
  progress: number;
  /** Unix time [s]. */
  opened_at: number;
  /** until its end at its override [s]; if `duration_s` is unknown, until the end of what is planned. */
  eta_s?: number | null;
  fault?: Fault | null;
  rejected?: number;
  diagnostics?: Diagnostic[];
  resume_of?: string | null;
  /** Unix time [s]. */
  ended_at?: number | null;
  /** of the whole program at 100 %, as its text was simulated [s]; null: not simulated. */
  duration_s?: number | null;
  /** its last message to the operator; while it is paused, what to do before it is resumed. */
  notice?: string;
  /**
   * share of its lines that the simulation has reached; below 1 `duration_s` is an estimate from the lines so
   * far.
   */
  simulated?: number;
  /** how many of its remaining lines wait for an operator, as far as simulated; `eta_s` excludes these waits. */
  pauses?: number;
  /**
   * the input that M66, or a code of `[dialect.waits]`, waits for, the inputs that hold it (docs/io.md), or the
   * program that must leave first (docs/clearance.md); empty: none.
   */
  waits_for?: string;
  /** as in `Ack`; 0 in programs of an earlier start of the server. */
  rejections?: number;
  /** of a program in servo mode; null: it is not in servo mode. */
  servo?: ServoStatus | null;
  /** as in `Ack`. */
  reason?: string;
  /** as in `OpenRequest`; null: a program of an earlier start of the server (`continuation` reports them). */
  block_delete?: boolean | null;
  /** as in `OpenRequest`; null: a program of an earlier start of the server (`continuation` reports them). */
  optional_stop?: boolean | null;
}

/** Newest first. */
export interface ProgramsReply {
  programs: ProgramStatus[];
}

/** The programs that the server knows, the newest first. */
export interface ProgramsRequest {
  /** only this one. */
  program?: string | null | undefined;
  /** those that have ended too. */
  ended?: boolean | undefined;
  limit?: number | undefined;
}

/** How much of the text has arrived: the next part begins at `received`. */
export interface PutTextReply {
  /** of the text [bytes]. */
  received: number;
  /** in this part of it. */
  lines: number;
  /** all of it has arrived. */
  complete: boolean;
}

/** The next part of a program's text, for `check`, and for the times of programs that run it. */
export interface PutTextRequest {
  /** of the whole text in UTF-8. */
  sha256: string;
  /** of the whole text [bytes]. */
  size: number;
  /** where the part begins [bytes]. */
  offset: number;
  /** its bytes; characters may be split. */
  part: Uint8Array;
}

/** The recording's name. */
export interface RecordReply {
  name: string;
}

/** Saves the black box, the last minutes. `reason` is in the file and in its name. */
export interface RecordSaveRequest {
  reason?: string | undefined;
}

/** Records every cycle into a file on the server from now on. */
export interface RecordStartRequest {
  /** of the recording; empty: the time. */
  name?: string | undefined;
  /** when it ends by itself; null: only when it is stopped. */
  max_s?: number | null | undefined;
}

/** Ends a recording; without a name the only one. The reply comes once the file is complete. */
export interface RecordStopRequest {
  name?: string | undefined;
}

/** The recorder. */
export interface RecorderStatus {
  /** of the black box in memory. */
  held_s: number;
  /** of the black box in memory. */
  held_bytes: number;
  /** since the start; the recorder came too late for them. */
  missed_cycles: number;
  /** names of the recordings under way. */
  writing: string[];
}

/** A recording on the server's disk. */
export interface RecordingInfo {
  /** without a suffix. */
  name: string;
  /** `blackbox` was written by itself or by `record_save`. */
  kind: RecordingKind;
  /** `unfinished` was left by a recorder that was killed, and is repaired at the next start. */
  state: RecordingState;
  /** bytes. */
  size: number;
  /** Unix time [s]. */
  modified_at: number;
}

/** Bytes of a recording from `offset` on; `size` is the whole file's. */
export interface RecordingPart {
  name: string;
  offset: number;
  size: number;
  data: Uint8Array;
}

/** Part of a recording's file, for a download in parts; answered with a `RecordingPart`. */
export interface RecordingReadRequest {
  name: string;
  offset?: number | undefined;
  size?: number | undefined;
}

/** The newest first; `recorder` null: it is not running. `folder`: on the server's disk. */
export interface RecordingsReply {
  recordings: RecordingInfo[];
  recorder: RecorderStatus | null;
  folder: string;
}

/** Lists the recordings. */
export interface RecordingsRequest {
}

/** Sets the positions of axes, by number as text [mm, deg]; nothing moves. */
export interface ReferenceRequest {
  positions: Record<string, number>;
}

/** Rejects a run; its client is shown the reason. An approval for a while that was given with it ends. */
export interface RejectRequest {
  /** of the text, or at least its first 8 digits. */
  sha256: string;
  reason?: string | undefined;
  /** as in `ArmRequest`. */
  number?: number | null | undefined;
}

/** Clears a latched fault or emergency stop; axes stay de-energized until captured (G1010). */
export interface ResetRequest {
  axes?: number[] | null | undefined;
}

/** Runs whose envelope was approved for a while (`standing_s`), each with its `remaining_s`. */
export interface RunApprovalsRequest {
}

/** The program that was started. */
export interface RunArmedReply {
  program: string;
  override: number;
}

/** Starts an armed program; the text is exactly that of the request. */
export interface RunArmedRequest {
  text: string;
  /** as in `OpenRequest`. */
  grace_s?: number | undefined;
}

/** Simulated path of a request, sampled at equal intervals, for a picture. */
export interface RunPath {
  /** n moments after the start of the run [s]. */
  time_s: number[];
  /** for each axis of the request n setpoints [mm or deg]. */
  positions: number[][];
  /** paths of the tools that these axes move. */
  tools: ToolPath[];
}

/** A request with its text and the path of its simulation. */
export interface RunPreviewReply {
  run: RunRequestStatus;
  text: string;
  path: RunPath;
  /**
   * what `mcserver certify` signs of it, as JSON: the initial state of its simulation, and a digest of its
   * setpoints.
   */
  certifiable: string;
  /** of its check and simulation, the first ones */
  warnings?: Diagnostic[];
  /** how many more there were. */
  unshown_warnings?: number;
}

/** What an operator reviews before arming: the text and its simulated path. */
export interface RunPreviewRequest {
  /** of the text, or at least its first 8 digits. */
  sha256: string;
}

/** `ok` false: the text has faults, and nothing waits. `run`: what an operator is shown. */
export interface RunRequestReply {
  ok: boolean;
  diagnostics: Diagnostic[];
  run?: RunRequestStatus | null;
}

/** Requests a run of a text. It is checked and simulated, and moves nothing. */
export interface RunRequestRequest {
  /** the program. */
  text: string;
  /** for people. */
  name?: string | undefined;
  /** the only axes that it may move; null: those named in the text. */
  axes?: number[] | null | undefined;
  /** a file of `mcserver certify` for exactly this run, which arms it; null: a person must. */
  certificate?: string | null | undefined;
  /** as in `OpenRequest`, and part of what is approved; a certificate has its own. */
  block_delete?: boolean | null | undefined;
  /** as in `OpenRequest`, and part of what is approved; a certificate has its own. */
  optional_stop?: boolean | null | undefined;
}

/** A request: what would move, how far, how long; `remaining_s` until it or its arming is over. */
export interface RunRequestStatus {
  sha256: string;
  client: string;
  name: string;
  state: RunState;
  axes: number[];
  duration_s: number;
  extents: Extent[];
  remaining_s: number;
  override: number;
  /** who armed or rejected it. */
  operator: string;
  /** those of the run, as in `OpenRequest`. */
  block_delete: boolean;
  /** those of the run, as in `OpenRequest`. */
  optional_stop: boolean;
  /** a new one each time that the run is requested, even with the same text. */
  number?: number;
  /** why it was rejected. */
  reason?: string;
  /** what the run leaves changed for later runs, a sentence each. */
  effects?: string[];
  /** extents of the tools' tips. */
  tools?: ToolExtent[];
  /** SHA-256 of everything that the simulation read. */
  digest?: string;
  /** which of this has changed since, a sentence each; if there is any it cannot start. */
  changed?: string[];
  /** hash of the approval for a while that has armed it; the run stays inside its envelope. */
  approval?: string;
  /** what of the run is outside the envelope approved for its client, a sentence each. */
  beyond?: string[];
  /** it is approved for a while, for streamed targets, too. */
  servo?: boolean;
}

/** The oldest first. */
export interface RunRequestsReply {
  requests: RunRequestStatus[];
}

/** Requests that wait for an operator, are armed, or were started recently. */
export interface RunRequestsRequest {
}

/** A node that answers on a bus. */
export interface ScannedNode {
  /** node number; on EtherCAT the position on the line. */
  node: number;
  /** number of the device profile, from 1000h. */
  profile: number;
  /** the same in words. */
  what: string;
  /** identity 1018h; null: the node did not give it. */
  vendor_id?: number | null;
  /** identity 1018h; null: the node did not give it. */
  product_code?: number | null;
  /** identity 1018h; null: the node did not give it. */
  revision?: number | null;
  /** identity 1018h; null: the node did not give it. */
  serial?: number | null;
  /** modes of operation that 6502h lists. */
  modes?: string[];
  /** axis of the running machine that this drive moves; null: no axis has it. */
  axis?: number | null;
  /** path of the EDS file in the machine file, or of one with this vendor and product; empty: none was found. */
  eds?: string;
  /**
   * values of further objects, by keys such as `"6091:1"`: encoder (608Fh), gear (6091h), feed (6092h), rated
   * torque (6076h [mN·m]), greatest motor speed (6080h [1/min]), travel limits (607Dh).
   */
  objects?: Record<string, number>;
}

/** Values of an object in each cycle. */
export interface ScopeSignal {
  /** index and subindex, such as `6064h:00`; empty: the values were computed. */
  object: string;
  name: string;
  /** unit of the values; empty: the drive's own. */
  unit: string;
  /** one for each cycle, float64, little endian; NaN: no value came in it. */
  values: Uint8Array;
}

/** Reads an object of a drive's dictionary (CiA 301). */
export interface SdoReadRequest {
  /** of the object. */
  index: number;
  /** of the object. */
  subindex?: number | undefined;
  /** whose drive; or `node`, with `bus` where several buses have that number. */
  axis?: number | null | undefined;
  node?: number | null | undefined;
  bus?: string | undefined;
  /** how to read the bytes; null: by the drive's EDS, or the standard's objects. */
  type?: SdoType | null | undefined;
}

/** Value of an object that was read or written. */
export interface SdoReply {
  axis: number;
  bus: string;
  /** node number; on EtherCAT the position on the line. */
  node: number;
  index: number;
  subindex: number;
  type: SdoType;
  /** of the type `bytes` as hexadecimal text. */
  value: boolean | number | string;
  /** the transferred bytes, little endian. */
  raw: Uint8Array;
  /** kind of the bus. */
  fieldbus?: Fieldbus;
}

/** Writes an object; `value` may be text: a number such as `0x10`, or hexadecimal for `bytes`. */
export interface SdoWriteRequest {
  index: number;
  subindex?: number | undefined;
  axis?: number | null | undefined;
  node?: number | null | undefined;
  bus?: string | undefined;
  type?: SdoType | null | undefined;
  value: boolean | number | string;
}

/** The program that follows targets, sent as `StreamTargets` on `in/{client}/{program}`; its axes in order. */
export interface ServoReply {
  program: string;
  axes: number[];
}

/** Leases axes for targets that the client streams, and energizes them. */
export interface ServoRequest {
  /** the axes to lease, all free now; null: all of the machine. */
  axes?: number[] | null | undefined;
  /** for people. */
  name?: string | undefined;
  /**
   * lowest position that targets may command, by axis number as text [mm or deg]; only together with `high`. A
   * machine with bodies or zones needs both: if these would not stay clear everywhere between, the program ends
   * as faulted and nothing moves.
   */
  low?: Record<string, number> | null | undefined;
  /** highest position that targets may command, by axis number as text [mm or deg]. */
  high?: Record<string, number> | null | undefined;
}

/** The targets of a program in servo mode, counted since it was opened. */
export interface ServoStatus {
  /** messages accepted. */
  taken: number;
  /** numbers that never came, or came after later ones. */
  lost: number;
  /** came after their validity. */
  late: number;
  /** repeated the newest number, or had a lower one. */
  doubled: number;
  /** repeated the newest number, or had a lower one. */
  reordered: number;
  /** too far from the previous point, and not confirmed by the next one. */
  jumped: number;
  /** not finite, not of the program's axes, or a pose that the tool cannot reach. */
  refused: number;
  /** of those taken, beyond an axis's travel. */
  clipped: number;
  /** of those taken, faster than a tool's axes can go. */
  slowed: number;
  /** between messages, by the sender's clock. */
  interval_s: number;
  /** of the newest one, beyond the quickest. */
  age_s: number;
}

/** Sets a simulated input by its name, like `SetOutputRequest`; its script ends. */
export interface SetInputRequest {
  input: string;
  value: boolean | number;
}

/** Sets an output by its name; digital: true and false, or 1 and 0. */
export interface SetOutputRequest {
  output: string;
  value: boolean | number;
}

/** The value that an input or output has from the next cycle on. */
export interface SetReply {
  name: string;
  value: number;
}

/** Names a row of the tables, or sets how long a tool may cut; what is nil stays. */
export interface SetTableRowRequest {
  /** `G54` to `G59.3`, or `T3`. */
  row: string;
  /** for people; empty removes it. */
  name?: string | null | undefined;
  /** how long the tool may cut; 0: no limit. */
  life_min?: number | null | undefined;
  /** how long it has cut, 0 when a new one is fitted. */
  used_min?: number | null | undefined;
  /** the person, if a client serves several. */
  by?: string | undefined;
}

/** What `mcserver simulate --json` prints. */
export interface SimulateReply {
  ok: boolean;
  duration_s: number;
  feed_length_mm: number;
  /** those that took time, by start. */
  lines: LineReport[];
  /** by number as text. */
  axes: Record<string, AxisTravel>;
  diagnostics: Diagnostic[];
  /** of the systems used or set. */
  work_offsets?: WorkOffset[];
  /** their values at the end, by name. */
  inputs?: Record<string, number>;
  /** their values at the end, by name. */
  outputs?: Record<string, number>;
  /** if it was requested. */
  path?: SimulatedPath | null;
  /** of a machine that names bodies. */
  clearance?: ClearanceReport | null;
  /** results of those of the request, in their order. */
  assertions?: Judged[];
  /** to the motion of `against`. */
  difference?: Difference | null;
}

/** Runs a program's text on a virtual clock and simulated drives. */
export interface SimulateRequest {
  text: string;
  /** start the axes there [mm, deg]; null: where the machine file starts simulated drives. */
  positions?: Record<string, number> | null | undefined;
  /** maximum number of points in the reply's `path`; 0: no path. */
  path_points?: number | undefined;
  /** whether the reply has the times of every line. */
  lines?: boolean | undefined;
  /** are judged on every setpoint; one that does not hold is a fault (MC330). */
  assertions?: Assertion[] | undefined;
  /** another program's text, from the same start: the reply has the `difference` to its motion. */
  against?: string | null | undefined;
  /**
   * whose run it is: `agent`, one that a person approves, or `operator`, any other; zones of the other role do
   * not count. null: all zones count.
   */
  role?: RunRole | null | undefined;
  /** as of `OpenRequest`. */
  block_delete?: boolean | null | undefined;
  /** as of `OpenRequest`. */
  optional_stop?: boolean | null | undefined;
}

/** Points at equal distances along the axes' travel. */
export interface SimulatedPath {
  /** the program's line at each point. */
  lines: number[];
  /** the points of each tool. */
  tips: TipPath[];
}

/** The whole machine's state now: a `MachineStatus`. */
export interface StatusRequest {
}

/** Starts the next line of a program in single-line mode. */
export interface StepRequest {
  program: string;
}

/**
 * Cumulative: lines through `accepted` are accepted, through `done` have ended; `credit` more fit. `rejections`:
 * how many the program has had.
 */
export interface SubmitReply {
  program: string;
  accepted: number;
  done: number;
  credit: number;
  rejections?: number;
}

/**
 * Lines `first`, `first + 1`, …; without `judge` the reply does not wait for the verdict. `rejections`: how many
 * the client knows of; lines from before a rejection are refused. null: unknown, the lines are taken as current.
 */
export interface SubmitRequest {
  program: string;
  first: number;
  lines: string[];
  judge?: boolean | undefined;
  rejections?: number | null | undefined;
}

/** An output, or the speed or torque of an axis, that differs from its value in the program. */
export interface Switched {
  /** of the output, or such as `axis 3`. */
  name: string;
  /** value in the program before the line. */
  there: number;
  /** present value. */
  now: number;
  /** of both values. */
  unit?: string;
}

/** Who changed a row of the tables; what one program does to one row in turn is one change. */
export interface TableChange {
  /** Unix time [s]. */
  wall: number;
  /** whose program it was. */
  client: string;
  /** its id. */
  program: string;
  /** of the program. */
  name: string;
  /** `G54` to `G59.3`, or `T3`. */
  row: string;
  /**
   * by axis number, `R` of a turned system, or `length` and `diameter` [m, rad; in messages mm, deg]; empty: the
   * row was not there. Or a tool's `life` and what it has `used` [s; in messages min].
   */
  before: Record<string, number>;
  /**
   * by axis number, `R` of a turned system, or `length` and `diameter` [m, rad; in messages mm, deg]; empty: the
   * row was not there. Or a tool's `life` and what it has `used` [s; in messages min].
   */
  after: Record<string, number>;
  /** its name before and after, where that was changed. */
  was_called?: string;
  /** its name before and after, where that was changed. */
  called?: string;
}

/** The tables that programs start with, and who changed them. */
export interface Tables {
  /** systems that were set; the others read zero at the machine's zero. */
  offsets: WorkOffset[];
  /** whether the machine's programs have one, with G43 and G10 L1. */
  tool_table: boolean;
  /** in the order of their numbers. */
  tools: ToolRow[];
  /** the newest first. */
  changes: TableChange[];
  /** of systems, by system. */
  names?: Record<string, string>;
}

/** The tables that programs start with. */
export interface TablesRequest {
}

/** How to read `tele/batch`: its columns, its fields and the maximum of cycles in a message. */
export interface TelemetryInfo {
  axes: number[];
  fields: string[];
  cycles_a_message: number;
  state_hz: number;
}

/** How far apart two paths of a tip are, whatever their times. */
export interface TipDifference {
  /** null: the axes 0, 1 and 2 themselves. */
  tool: number | null;
  /** the greatest distance of a point of one path from the other one. */
  apart_mm: number;
  /** where that is. */
  time_s: number;
  /** where that is. */
  line: number;
  /** they are of the other program, whose path goes astray there. */
  other: boolean;
}

/** Where a tool goes [mm]; `tool` null: the axes 0, 1 and 2 themselves. */
export interface TipPath {
  tool: number | null;
  points: number[][];
}

/** Least and greatest X, Y and Z of a tool's tip in the base frame [mm], and its greatest speed [mm/s]. */
export interface ToolExtent {
  tool: number;
  low: number[];
  high: number[];
  speed: number;
}

/** One tool of G01 … Tn. */
export interface ToolInfo {
  number: number;
  frame: string;
  axes: number[];
  orientation: boolean;
  euler: string;
  /** the frame of its poses; empty: the base. */
  work?: string;
}

/** The jog's program, for `abort` and for keeping it alive. */
export interface ToolJogReply {
  program: string;
  /**
   * which joint ends the motion, and why, for people; empty: nothing within the tool's reach, or the jog was kept
   * alive.
   */
  obstacle?: string;
}

/** Moves a tool's tip in a straight line, by all its joints, until it is stopped or cannot continue. */
export interface ToolJogRequest {
  /** number of the machine file. */
  tool: number;
  /** X Y Z to move along that axis of `frame`, A B C to turn about it with the tip at rest. */
  word: ToolDirection;
  /**
   * of the tip [mm/s], of a turn [deg/s], signed. Near a singular position, and where a joint's limit is lower,
   * it is slower.
   */
  velocity: number;
  /** the base, or the tool itself. */
  frame?: ToolFrame | undefined;
  /** dead-man timeout, as in `jog` (default 0.5 s). */
  hold_s?: number | null | undefined;
  /** id of the running jog that this request keeps alive. */
  program?: string | null | undefined;
  /** the person, if a client serves several. */
  by?: string | undefined;
}

/** Path of a tool; `position`: lists of X, of Y and of Z at the moments of the `RunPath` [mm]. */
export interface ToolPath {
  tool: number;
  position: number[][];
}

/** Where a tool's frame is: `[x, y, z]` in mm, `[a, b, c]` in deg. */
export interface ToolPose {
  number: number;
  position: number[];
  orientation: number[];
}

/** A line of the tool table [mm], for G43. */
export interface ToolRow {
  number: number;
  length: number;
  diameter: number;
  /** by G10 L1, so that it differs from the machine file. */
  changed?: boolean;
  name?: string;
  /** how long it may cut; 0: not set. */
  life_min?: number;
  /** how long it has cut, counted in G01 to G03 while its spindle turns. */
  used_min?: number;
}

/** Gains of a control loop and its stability margins. */
export interface TunedLoop {
  name: string;
  /** by the keys of `[axis.drive]`. */
  gains: Record<string, number>;
  /**
   * in mode cst the least and the greatest inertia, as multiples of the measured one, with which the loop is
   * stable; in mode csv `greatest` alone, the multiple of its gain up to which it is stable; 0: it is not stable.
   */
  least: number;
  /**
   * in mode cst the least and the greatest inertia, as multiples of the measured one, with which the loop is
   * stable; in mode csv `greatest` alone, the multiple of its gain up to which it is stable; 0: it is not stable.
   */
  greatest: number;
  /** phase margin [deg]. */
  phase_deg: number;
  /** crossover frequency [Hz] and phase margin [deg] on the measured response; null: not known. */
  crossover_hz?: number | null;
  /** crossover frequency [Hz] and phase margin [deg] on the measured response; null: not known. */
  measured_phase_deg?: number | null;
  /** multiple of the gains up to which the loop is stable on that response; null: more than could be measured. */
  measured_gain?: number | null;
}

/** One step of an approach: a move of axes, or a wait for an input. */
export interface WayStep {
  /** description for people. */
  text: string;
  /** end of the move, by axis number as text [mm, deg]; empty: no axis moves. */
  targets?: Record<string, number>;
  /** each axis moves at its own limits; otherwise at the approach velocity. */
  rapid?: boolean;
}

/** One fault of a program, placed in its text; `line` is the client's line number. */
export interface Diagnostic {
  code: string;
  message: string;
  line?: number;
  column?: number;
  end_column?: number;
  hint?: string;
  severity?: Severity;
  tool?: number | null;
  residual_mm?: number | null;
  axis?: number | null;
  edit?: Edit | null;
}

/** Withdraws a request; only the user who made it may. */
export interface WithdrawRequest {
  /** of the text, or at least its first 8 digits. */
  sha256: string;
}

/** The origin of a work coordinate system. */
export interface WorkOffset {
  /** such as `G54`. */
  system: string;
  /** where the axes read zero, by number [mm, deg]; an axis that is omitted reads as the machine does. */
  origin: Record<string, number>;
  /**
   * angle by which X and Y are turned about Z, counter-clockwise (G10 L2 R) [deg]: a single axis does not
   * determine what they read then.
   */
  rotation?: number;
}

export interface WriteMachineFileReply {
  /** the new text is on the disk. */
  written: boolean;
  /** name of the file that keeps the old one; empty: none. */
  before: string;
  /** errors and warnings of the new text. */
  diagnostics: Diagnostic[];
}

/**
 * Checks a text as `mcserver machine check` does, and writes it if it has no error. The server continues with the
 * old one until it is restarted.
 */
export interface WriteMachineFileRequest {
  /** all of the new file. */
  text: string;
  /** of the text that was edited, as `machine_file` returned it. */
  sha256: string;
  /** nothing is written. */
  only_check?: boolean | undefined;
  /** the person, if a client serves several. */
  by?: string | undefined;
}
