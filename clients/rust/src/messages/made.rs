// Made by `python -m mcserver.contract.sdk clients`: change the server's messages instead.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::binary::Bytes;
use super::words::words;

/// A value of a drive's dictionary.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Value {
    /// A truth value.
    Bool(bool),
    /// A signed number.
    Integer(i64),
    /// A number beyond them.
    Unsigned(u64),
    /// A float.
    Float(f64),
    /// A text, or bytes as hexadecimal.
    Text(String),
}

words!(AxisKind {
    Linear = "linear", Rotary = "rotary",
});

words!(AxisState {
    Off = "off", Starting = "starting", Standstill = "standstill", Moving = "moving", Speed = "speed",
    Torque = "torque", Stopping = "stopping", Released = "released", Fault = "fault",
});

words!(AxisUnit {
    Mm = "mm", Deg = "deg",
});

words!(BedMeshState {
    Off = "off", File = "file", Probed = "probed",
});

words!(ChannelKind {
    Digital = "digital", Analog = "analog",
});

words!(DrivePhase {
    Booting = "booting", Operational = "operational", Lost = "lost", Restarting = "restarting",
    Failed = "failed", Closed = "closed",
});

words!(EventKind {
    ServerStarted = "server.started", ServerStopping = "server.stopping", ProgramOpened = "program.opened",
    ProgramStarted = "program.started", ProgramHeld = "program.held", ProgramResumed = "program.resumed",
    ProgramPaused = "program.paused", ProgramMessage = "program.message", ProgramClosed = "program.closed",
    InputRead = "input.read", ProgramEnded = "program.ended", LinesStarted = "lines.started",
    LinesEnded = "lines.ended", LineRejected = "line.rejected", Fault = "fault", Warning = "warning",
    Estop = "estop", Reset = "reset", Override = "override", Command = "command", ClientGone = "client.gone",
    Recording = "recording", AxisHoming = "axis.homing", AxisHomed = "axis.homed",
    AxisUnhomed = "axis.unhomed", Probe = "probe", DriveEmergency = "drive.emergency",
    DriveLost = "drive.lost", DriveBack = "drive.back", DriveRebooted = "drive.rebooted",
    DriveStarted = "drive.started", DriveFailed = "drive.failed", BusForeignMaster = "bus.foreign_master",
    BusLost = "bus.lost", BusBack = "bus.back",
});

words!(Fieldbus {
    Can = "can", Ethercat = "ethercat",
});

words!(ToolFrame {
    Base = "base", Tool = "tool",
});

words!(LoopMode {
    Cst = "cst", Csv = "csv",
});

words!(MachineState {
    Ready = "ready", Fault = "fault", Estop = "estop",
});

words!(OnDisconnect {
    Finish = "finish", Stop = "stop",
});

words!(Outputs {
    Set = "set", Leave = "leave",
});

words!(ProgramState {
    Queued = "queued", Running = "running", Held = "held", Paused = "paused", Ending = "ending",
    Finished = "finished", Aborted = "aborted", Rejected = "rejected", Faulted = "faulted",
    Interrupted = "interrupted",
});

words!(Quantity {
    End = "end", Position = "position", Travel = "travel", Speed = "speed", Duration = "duration",
    Clearance = "clearance",
});

words!(RecordingKind {
    Recording = "recording", Blackbox = "blackbox",
});

words!(RecordingState {
    Writing = "writing", Done = "done", Unfinished = "unfinished",
});

words!(RunRole {
    Agent = "agent", Operator = "operator",
});

words!(RunState {
    Waiting = "waiting", Armed = "armed", Started = "started", Rejected = "rejected",
});

words!(SdoType {
    Bool = "bool", I8 = "i8", I16 = "i16", I24 = "i24", I32 = "i32", I64 = "i64", U8 = "u8", U16 = "u16",
    U24 = "u24", U32 = "u32", U64 = "u64", F32 = "f32", F64 = "f64", Str = "str", Utf16 = "utf16",
    Bytes = "bytes",
});

words!(Severity {
    Error = "error", Warning = "warning",
});

words!(ToolDirection {
    X = "X", Y = "Y", Z = "Z", A = "A", B = "B", C = "C",
});

/// Payload of `ack/{program}`: cumulative, so a lost one does not matter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Ack {
    pub program: String,
    /// lines through this number are accepted and journaled.
    pub accepted: u64,
    /// this line and every one before it have ended: their setpoints have been passed, and after an exact
    /// stop the axes are in position. Between exact stops an axis may lag by its following error, at most
    /// `max_following_error`: a stricter condition would make each line a stop.
    pub done: u64,
    /// how many lines after `accepted` fit now.
    pub credit: u64,
    /// the program's.
    pub state: ProgramState,
    /// number of the line that was found faulty; it is the next one expected. 0: none.
    #[serde(default)]
    pub rejected: u64,
    /// what is wrong with it.
    #[serde(default)]
    pub diagnostics: Vec<Diagnostic>,
    /// what stopped the program.
    #[serde(default)]
    pub fault: Option<Fault>,
    /// the line number expected, set if the acknowledged message left a gap.
    #[serde(default)]
    pub expected: u64,
    /// how many lines of the program have been rejected so far. An acknowledgement with a smaller count than
    /// an earlier one is older: its numbers are of lines that were discarded.
    #[serde(default)]
    pub rejections: u64,
    /// why it was aborted: by whom, or a code; empty in programs of an earlier start of the server.
    #[serde(default)]
    pub reason: String,
}

/// A number that a button asks for, in the units of its text; `first` is shown first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ArgumentInfo {
    pub name: String,
    pub low: f64,
    pub high: f64,
    pub first: f64,
    pub unit: String,
}

/// Arms a text once.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ArmRequest {
    /// of the text, or at least its first 8 digits.
    pub sha256: String,
    /// how long it may be started.
    pub seconds: f64,
    /// the greatest feed override \[%\].
    #[serde(rename = "override")]
    pub override_percent: f64,
    /// of the request that was reviewed: one that was repeated since is not armed; none: any.
    pub number: Option<u64>,
    /// for this time every other run that the same client requests, and that stays inside the envelope of
    /// this run, is armed at its request; 0: only this run, once.
    pub standing_s: f64,
    /// for the same time it may also stream targets, inside the extents, speeds and duration of this run
    /// (`servo_armed`); no simulation shows these beforehand.
    pub servo: bool,
}

impl ArmRequest {
    /// All that may be left out is as the server has it.
    #[must_use]
    pub fn new(sha256: impl Into<String>) -> Self {
        Self {
            sha256: sha256.into(),
            seconds: 60.0,
            override_percent: 100.0,
            number: None,
            standing_s: 0.0,
            servo: false,
        }
    }
}

/// One bound of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Assertion {
    /// `end`: where a coordinate ends; `position`: where it is at any time; `travel`: how far its greatest
    /// place is from its least; `speed`: of an axis, or of a tool's tip (`T3`); `duration` \[s\];
    /// `clearance`: the least between bodies \[mm\].
    pub what: Quantity,
    /// the coordinate: `X`, `7`, `T3.X`; a speed's axis or tool; empty for duration and clearance.
    #[serde(default)]
    pub of: String,
    /// bounds, which belong to it \[mm or deg, per second\]; none: none to this side.
    #[serde(default)]
    pub least: Option<f64>,
    /// bounds, which belong to it \[mm or deg, per second\]; none: none to this side.
    #[serde(default)]
    pub most: Option<f64>,
}

/// All axes, column-wise: every list has one entry for each of `index`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AxesStatus {
    pub index: Vec<u64>,
    pub position: Vec<f64>,
    pub setpoint: Vec<f64>,
    pub velocity: Vec<f64>,
    pub torque: Vec<f64>,
    pub state: Vec<AxisState>,
    /// whether the axis knows its position; axes without `\[axis.homing\]` always do.
    #[serde(default)]
    pub homed: Vec<bool>,
    /// how much the second drive of a gantry pair is further than its leader \[mm, deg\]; 0 for other axes.
    /// Empty on a machine without pairs.
    #[serde(default)]
    pub skew: Vec<f64>,
    /// whether the axis's drive does not answer: its position, velocity and torque are old. Empty while all
    /// answer.
    #[serde(default)]
    pub silent: Vec<bool>,
}

/// How an axis moves otherwise; the other program's minus this one's \[mm or deg\].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AxisDifference {
    pub axis: u64,
    pub unit: String,
    /// greatest difference of two setpoints of the same cycle; the shorter run rests at its end.
    pub most: f64,
    /// when, and the lines that run then.
    pub time_s: f64,
    /// when, and the lines that run then.
    pub line: u64,
    /// when, and the lines that run then.
    pub other_line: u64,
    /// differences of the least, greatest and last setpoint.
    pub min: f64,
    /// differences of the least, greatest and last setpoint.
    pub max: f64,
    /// differences of the least, greatest and last setpoint.
    pub end: f64,
}

/// One axis; limits in mm or deg and seconds, none where not limited. `homing`: how it finds its reference;
/// none: its encoder's reading is its position. `letter`: an additional letter by which programs of the
/// machine's profile name it, such as `E`; empty: none. `spindle`: M3, M4, M5 and S turn it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AxisInfo {
    pub index: u64,
    #[serde(rename = "type")]
    pub kind: AxisKind,
    pub unit: AxisUnit,
    pub max_velocity: f64,
    pub max_acceleration: f64,
    pub drive: String,
    #[serde(default)]
    pub max_jerk: Option<f64>,
    #[serde(default)]
    pub min_position: Option<f64>,
    #[serde(default)]
    pub max_position: Option<f64>,
    #[serde(default)]
    pub in_position: f64,
    #[serde(default)]
    pub homing: Option<String>,
    #[serde(default)]
    pub letter: String,
    #[serde(default)]
    pub spindle: bool,
}

/// An axis of a program that is to start at a line.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AxisStart {
    pub axis: u64,
    pub unit: String,
    /// present position \[mm, deg\].
    pub now: f64,
    /// position in the program before the line \[mm, deg\]; none: unknown.
    #[serde(deserialize_with = "Option::deserialize")]
    pub there: Option<f64>,
    /// the axis is energized in the program there.
    pub energized: bool,
    /// the two positions differ by more than the axis's in-position tolerance, or `there` is unknown.
    pub away: bool,
}

/// Where an axis ends, and its least and greatest setpoint \[mm or deg\].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AxisTravel {
    pub position: f64,
    pub min: f64,
    pub max: f64,
    pub unit: String,
}

/// Frames that were counted while a bus was listened to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BusCounts {
    /// how long the bus was listened to \[s\].
    pub duration_s: f64,
    /// number of all frames.
    pub frames: u64,
    /// share of the bit rate that they took \[1\], each counted with the most stuff bits that it can have.
    pub load: f64,
    /// number of SYNCs.
    #[serde(default)]
    pub syncs: u64,
    /// longest time between two of them, by this computer's clock \[s\].
    #[serde(default)]
    pub longest_sync_gap_s: f64,
    #[serde(default)]
    pub nodes: Vec<NodeHealth>,
    /// number of frames by COB-ID, of COB-IDs that belong to no node of the machine file.
    #[serde(default)]
    pub strangers: BTreeMap<String, u64>,
}

/// Result of listening to a bus beside its master.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BusHealth {
    pub bus: String,
    /// numbers of frames; on EtherCAT a node is a position on the line.
    pub counts: BusCounts,
    /// the sign by which a master was noticed; empty: none was.
    #[serde(default)]
    pub master: String,
    /// number of errors and malformed packets at this computer's interface, on EtherCAT of frames with a
    /// wrong working counter.
    #[serde(default)]
    pub error_frames: u64,
    /// greatest following error by axis, between setpoint and encoder on the bus \[mm, deg\].
    #[serde(default)]
    pub following_errors: BTreeMap<String, f64>,
}

/// The nodes that answer on a bus.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BusScan {
    pub bus: String,
    pub address: String,
    pub nodes: Vec<ScannedNode>,
    /// text of a machine file with these drives, to start from.
    pub machine_file: String,
    /// kind of the bus.
    #[serde(default = "bus_scan_fieldbus")]
    pub fieldbus: Fieldbus,
}

fn bus_scan_fieldbus() -> Fieldbus {
    Fieldbus::Can
}

/// A program of the machine file, or a probing cycle, that people start from a page.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ButtonInfo {
    pub name: String,
    /// lines of G-code; `{name}` is the place of an argument.
    pub text: String,
    /// the lowest role that may press it, `operator` or `engineer`.
    pub role: String,
    /// what must be confirmed before it runs; empty: nothing.
    pub confirm: String,
    pub arguments: Vec<ArgumentInfo>,
    /// the heading under which pages show it.
    pub group: String,
}

/// As `mcserver check --json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CheckReply {
    pub ok: bool,
    pub diagnostics: Vec<Diagnostic>,
}

/// Every fault of a program's text; nothing runs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Default)]
pub struct CheckRequest {
    /// the whole text; or sha256: of one that was uploaded by `put_text`.
    pub text: Option<String>,
    /// start the axes there \[mm, deg\].
    pub positions: Option<BTreeMap<String, f64>>,
    pub sha256: Option<String>,
    /// as of `OpenRequest`.
    pub block_delete: Option<bool>,
    /// as of `OpenRequest`.
    pub optional_stop: Option<bool>,
}

/// The least distances of a run's bodies.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ClearanceReport {
    pub margin_mm: f64,
    /// none if all stayed apart by more than the margin plus 50 mm.
    #[serde(deserialize_with = "Option::deserialize")]
    pub least_mm: Option<f64>,
    /// that came nearer, the nearest first, 20 at most.
    pub pairs: Vec<PairClearance>,
    /// zones that an input switches, which count as on.
    #[serde(default)]
    pub assumed_on: Vec<String>,
}

/// `accepted`: the last line that will run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CloseReply {
    pub program: String,
    pub accepted: u64,
    pub done: u64,
    pub state: ProgramState,
}

/// No more lines will come; the accepted lines run to their end. `last`: the last line that was sent; the
/// program is only closed if it has been accepted.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CloseRequest {
    pub program: String,
    pub last: Option<u64>,
}

impl CloseRequest {
    /// All that may be left out is as the server has it.
    #[must_use]
    pub fn new(program: impl Into<String>) -> Self {
        Self {
            program: program.into(),
            last: None,
        }
    }
}

/// How a program would continue.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Continuation {
    /// its id, empty for a text.
    pub program: String,
    /// as it ended; lines through `done` are certain.
    pub name: String,
    /// as it ended; lines through `done` are certain.
    #[serde(deserialize_with = "Option::deserialize")]
    pub state: Option<ProgramState>,
    /// as it ended; lines through `done` are certain.
    pub done: u64,
    /// as it ended; lines through `done` are certain.
    pub accepted: u64,
    /// its text is known to its end, so nothing must be sent.
    pub whole: bool,
    /// of its whole text.
    #[serde(deserialize_with = "Option::deserialize")]
    pub sha256: Option<String>,
    /// the first that would run.
    pub line: u64,
    /// of the text around that line.
    pub first: u64,
    /// of the text around that line.
    pub lines: Vec<String>,
    /// codes in force there.
    pub modal: Vec<String>,
    /// axes that are energized first.
    pub energize: Vec<u64>,
    /// where each is, and where the program has it there.
    pub axes: Vec<AxisStart>,
    /// the moves that bring them there, in order.
    pub way: Vec<WayStep>,
    /// what the program had switched differently from now.
    pub switched: Vec<Switched>,
    /// what prevents it; one that has `confirm` is met by that field of the request.
    pub needs: Vec<Need>,
    /// the settings that it continues with.
    pub block_delete: bool,
    /// the settings that it continues with.
    pub optional_stop: bool,
}

/// What a start in the middle of a program would do; nothing moves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Default)]
pub struct ContinuationRequest {
    /// one that has ended; if others have continued it, the last of these is meant.
    pub program: Option<String>,
    /// the first that would run; none: the one after the last that is done.
    pub line: Option<u64>,
    /// lines 1 … line - 1 of a text, instead of `program`.
    pub before: Vec<String>,
    /// of it; none: all of the machine.
    pub axes: Option<Vec<u64>>,
    /// of the text, as in `OpenRequest`; a program keeps its settings.
    pub block_delete: Option<bool>,
    /// of the text, as in `OpenRequest`; a program keeps its settings.
    pub optional_stop: Option<bool>,
}

/// The program that continues, like `OpenReply`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ContinueReply {
    pub program: String,
    pub state: ProgramState,
    pub axes: Vec<u64>,
    pub expected: u64,
    pub credit: u64,
    pub instance: String,
    /// the first that runs.
    pub line: u64,
    /// the program that it continues.
    pub resume_of: String,
    /// the server has all of its lines; otherwise the client sends those from `expected` on.
    pub whole: bool,
}

/// Continues a program that has ended.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ContinueRequest {
    /// as in `ContinuationRequest`.
    pub program: String,
    /// as in `ContinuationRequest`.
    pub line: Option<u64>,
    /// axes may move as `continuation` shows, if the machine file names no safe way.
    pub way: bool,
    /// set what the program had switched, or leave it as it is; none: not specified.
    pub outputs: Option<Outputs>,
    /// as in `OpenRequest`.
    pub on_disconnect: OnDisconnect,
    /// as in `OpenRequest`.
    pub grace_s: f64,
    /// begin held.
    pub hold: bool,
}

impl ContinueRequest {
    /// All that may be left out is as the server has it.
    #[must_use]
    pub fn new(program: impl Into<String>) -> Self {
        Self {
            program: program.into(),
            line: None,
            way: false,
            outputs: None,
            on_disconnect: OnDisconnect::Stop,
            grace_s: 10.0,
            hold: false,
        }
    }
}

/// How another program moves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Difference {
    /// every setpoint is the same to the bit.
    pub same: bool,
    /// the other one's minus this one's.
    pub duration_s: f64,
    /// those whose setpoints differ.
    pub axes: Vec<AxisDifference>,
    /// all.
    pub tips: Vec<TipDifference>,
}

/// How slow the disk under the journal is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DiskStatus {
    /// Unix time from which on it is slow \[s\].
    pub since: f64,
    /// how long messages have waited for the journal's commit \[s\].
    pub commit_s: f64,
    /// how long the current sync has taken \[s\]; a power cut loses what was committed in that time.
    pub sync_s: f64,
    /// the longest of these since then \[s\].
    pub worst_s: f64,
}

/// Reply of methods that return no data: the programs concerned.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Done {
    pub programs: Vec<String>,
}

/// A drive on a bus and its state.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DriveInfo {
    pub axis: u64,
    pub kind: String,
    pub bus: String,
    /// node number; on EtherCAT the position on the line.
    pub node: u64,
    /// state of the drive in the server's supervision.
    pub state: DrivePhase,
    /// NMT state in the last heartbeat, on EtherCAT the AL state; empty: no heartbeat has come yet.
    #[serde(default)]
    pub nmt: String,
    /// time since the last sign of life \[s\]; none: none has come yet.
    #[serde(default)]
    pub heartbeat_age_s: Option<f64>,
    /// 6041h; of a drive that streams telemetry its fault bits.
    #[serde(default)]
    pub statusword: Option<u64>,
    /// the same in words.
    #[serde(default)]
    pub status: String,
    /// objects 1000h, 1018h:01 and 1018h:02.
    #[serde(default)]
    pub device_type: Option<u64>,
    /// objects 1000h, 1018h:01 and 1018h:02.
    #[serde(default)]
    pub vendor_id: Option<u64>,
    /// objects 1000h, 1018h:01 and 1018h:02.
    #[serde(default)]
    pub product_code: Option<u64>,
    /// the last emergency message in words, on EtherCAT the error code 603Fh.
    #[serde(default)]
    pub emergency: String,
    /// its error code.
    #[serde(default)]
    pub emergency_code: Option<u64>,
    /// time since it came \[s\].
    #[serde(default)]
    pub emergency_age_s: Option<f64>,
    /// number of the drive's starts since the server started.
    #[serde(default)]
    pub boot_ups: u64,
    /// why the last configuration failed.
    #[serde(default)]
    pub message: String,
    /// newest values of its telemetry, and of objects that `monitor` in the machine file names.
    #[serde(default)]
    pub monitor: Vec<MonitoredValue>,
    /// kind of the bus.
    #[serde(default = "drive_info_fieldbus")]
    pub fieldbus: Fieldbus,
}

fn drive_info_fieldbus() -> Fieldbus {
    Fieldbus::Can
}

/// The objects of a drive, of one axis of its node.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DriveParameters {
    pub axis: u64,
    pub bus: String,
    /// node number; on EtherCAT the position on the line.
    pub node: u64,
    /// number of the axis among those of its node, from 0.
    pub node_axis: u64,
    /// digest of the drive's EDS; empty: it has none, and the objects are those of the standard.
    pub eds_sha256: String,
    pub parameters: Vec<ParameterInfo>,
    /// entries of the EDS that cannot be read, each with the reason.
    pub unreadable: Vec<String>,
    /// kind of the bus.
    #[serde(default = "drive_parameters_fieldbus")]
    pub fieldbus: Fieldbus,
}

fn drive_parameters_fieldbus() -> Fieldbus {
    Fieldbus::Can
}

/// The objects of an axis's drive.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DriveParametersRequest {
    pub axis: u64,
}

impl DriveParametersRequest {
    /// All that may be left out is as the server has it.
    #[must_use]
    pub fn new(axis: u64) -> Self {
        Self {
            axis,
        }
    }
}

/// Every mapped object of an axis's drive in each cycle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DriveScopeRequest {
    pub axis: u64,
    /// time kept.
    pub seconds: f64,
    /// such as `following error > 0.05`; empty: at once.
    pub trigger: String,
    /// fires also if the level is already met.
    pub level: bool,
    /// kept before the trigger; none: a quarter.
    pub before_s: Option<f64>,
    /// how long the trigger may take.
    pub timeout_s: f64,
}

impl DriveScopeRequest {
    /// All that may be left out is as the server has it.
    #[must_use]
    pub fn new(axis: u64) -> Self {
        Self {
            axis,
            seconds: 2.0,
            trigger: String::new(),
            level: false,
            before_s: None,
            timeout_s: 10.0,
        }
    }
}

/// Recording of every mapped object of an axis in each cycle, around a trigger.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DriveTrace {
    pub axis: u64,
    /// number of cycles.
    pub cycles: u64,
    /// length of a cycle \[s\].
    pub cycle_s: f64,
    /// time of the first cycle; the trigger is at time 0 \[s\].
    pub begin_s: f64,
    /// Unix time of time 0 \[s\].
    pub trigger_unix: f64,
    /// number of SYNCs that are missing in the recording.
    pub missing: u64,
    pub signals: Vec<ScopeSignal>,
}

/// The gains of an axis in mode cst or csv, by the motion of a program; `seconds`: time observed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DriveTuneRequest {
    pub axis: u64,
    pub seconds: f64,
}

impl DriveTuneRequest {
    /// All that may be left out is as the server has it.
    #[must_use]
    pub fn new(axis: u64) -> Self {
        Self {
            axis,
            seconds: 20.0,
        }
    }
}

/// Result of measuring an axis in mode cst or csv while it moves, and proposed gains of its loop.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DriveTuning {
    pub axis: u64,
    pub mode: LoopMode,
    /// in mode cst inertia \[kg·m²\], friction \[N·m\], viscous \[N·m·s/rad\], load \[N·m\], explained and
    /// uncertainty \[1\]; in mode csv scale \[1\], lag and uncertainty \[s\].
    pub measured: BTreeMap<String, f64>,
    /// the same in words.
    pub said: String,
    /// the loop with the gains of the machine file, then with the proposed ones.
    pub loops: Vec<TunedLoop>,
    /// lines to change in the machine file; empty: its gains fit.
    pub changes: Vec<String>,
    /// how to apply the changes.
    pub remedy: String,
    /// open-loop response with the gains of the machine file, as measured; empty: not known.
    pub frequency_hz: Vec<f64>,
    /// open-loop response with the gains of the machine file, as measured; empty: not known.
    pub gain_db: Vec<f64>,
    /// open-loop response with the gains of the machine file, as measured; empty: not known.
    pub phase_deg: Vec<f64>,
}

/// By bus.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DrivesHealthReply {
    pub buses: Vec<BusHealth>,
}

/// Health of the buses; `seconds`: how long to listen to them, all together.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DrivesHealthRequest {
    pub seconds: f64,
}

impl Default for DrivesHealthRequest {
    /// All that may be left out is as the server has it.
    fn default() -> Self {
        Self {
            seconds: 5.0,
        }
    }
}

/// By axis; empty if no drive is on a bus.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DrivesReply {
    pub drives: Vec<DriveInfo>,
}

/// Every drive on a bus.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DrivesRequest {}

/// By bus; each with a machine file to start from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DrivesScanReply {
    pub buses: Vec<BusScan>,
}

/// Scans a bus: every node number of CAN, every drive of EtherCAT; `bus` empty: all buses.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Default)]
pub struct DrivesScanRequest {
    pub bus: String,
}

/// A certain remedy: characters of the diagnostic's line and what replaces them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Edit {
    /// code points from 1, end exclusive.
    pub column: u64,
    /// code points from 1, end exclusive.
    pub end_column: u64,
    /// the replacement.
    pub text: String,
}

/// Payload of every `reply_err`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ErrorReply {
    pub code: String,
    pub message: String,
    #[serde(default)]
    pub hint: String,
    /// what the code's entry in docs/wire/errors.md lists, such as `expected`.
    #[serde(default)]
    pub details: BTreeMap<String, serde_json::Value>,
    /// faults of G-code, if the error concerns lines.
    #[serde(default)]
    pub diagnostics: Vec<Diagnostic>,
}

/// Emergency stop by rpc, and payload of the key `estop` (where it may be empty).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Default)]
pub struct EstopRequest {
    /// for people.
    pub reason: String,
    /// on the key `estop`, who stops, by its own account; a call has it in its key.
    pub client: String,
}

/// Payload of `event`; `seq` has no gap within one `instance`. Times `t` of two instances cannot be compared.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Event {
    pub seq: u64,
    /// executor time \[s\].
    pub t: f64,
    pub instance: String,
    /// determines which of the others are set (docs/wire/events.md).
    pub kind: EventKind,
    #[serde(default)]
    pub program: Option<String>,
    #[serde(default)]
    pub client: Option<String>,
    #[serde(default)]
    pub state: Option<ProgramState>,
    /// the last line started for `lines.started`; the line of a fault.
    #[serde(default)]
    pub line: u64,
    /// for `lines.ended`.
    #[serde(default)]
    pub lines: Vec<LineReport>,
    #[serde(default)]
    pub fault: Option<Fault>,
    #[serde(default)]
    pub diagnostics: Vec<Diagnostic>,
    /// why a program ended, an emergency stop's reason, a warning's code, a drive's or bus's code.
    #[serde(default)]
    pub reason: String,
    #[serde(default)]
    pub message: String,
    #[serde(default)]
    pub percent: Option<f64>,
    /// of a drive's event, or of homing.
    #[serde(default)]
    pub axis: Option<u64>,
    /// for `probe`.
    #[serde(default)]
    pub probe: Option<ProbeStatus>,
    /// Unix time of `t`, by the clock as it went then \[s\].
    #[serde(default)]
    pub wall: f64,
}

/// `oldest` is the first number that the server still holds; `newest` the last one published.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EventsReply {
    pub instance: String,
    pub oldest: u64,
    pub newest: u64,
    pub events: Vec<Event>,
}

/// Events that the server still holds, from number `since` on, oldest first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EventsRequest {
    pub since: u64,
    pub limit: u64,
}

impl Default for EventsRequest {
    /// All that may be left out is as the server has it.
    fn default() -> Self {
        Self {
            since: 0,
            limit: 500,
        }
    }
}

/// Least and greatest setpoint of an axis \[mm or deg\], and its greatest speed \[mm/s or deg/s\].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Extent {
    pub axis: u64,
    pub low: f64,
    pub high: f64,
    pub unit: String,
    #[serde(default)]
    pub speed: f64,
    /// the axis turns continuously at a speed (G1030): its positions are not bounded.
    #[serde(default)]
    pub turns: bool,
}

/// What stopped motion: a stable code, and the axis and line if they apply.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Fault {
    pub code: String,
    pub message: String,
    #[serde(default)]
    pub hint: String,
    #[serde(default)]
    pub axis: Option<u64>,
    #[serde(default)]
    pub line: u64,
    #[serde(default)]
    pub program: Option<String>,
    #[serde(default)]
    pub t: f64,
}

/// The program that homes, for `abort`, and its axes in the order of their homing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct HomeReply {
    pub program: String,
    pub axes: Vec<u64>,
}

/// Finds the references of axes, those with the lowest order first; none: of all that have a method.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Default)]
pub struct HomeRequest {
    pub axes: Option<Vec<u64>>,
}

/// Reply of `info`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Info {
    pub machine: String,
    pub server: String,
    /// versions of this key space that the server speaks.
    pub protocol: Vec<u64>,
    /// one start of the server; a different one means that earlier programs were interrupted.
    pub instance: String,
    /// Unix time of executor time 0, by the clock as it goes now \[s\].
    pub epoch: f64,
    pub cycle_s: f64,
    pub axes: Vec<AxisInfo>,
    pub tools: Vec<ToolInfo>,
    pub telemetry: TelemetryInfo,
    pub limits: LimitsInfo,
    pub methods: Vec<String>,
    #[serde(default)]
    pub inputs: Vec<InputInfo>,
    #[serde(default)]
    pub outputs: Vec<OutputInfo>,
    /// programs of the machine file that operators start, with places for numbers.
    #[serde(default)]
    pub buttons: Vec<ButtonInfo>,
    /// by which people find the machine.
    #[serde(default)]
    pub group: String,
    /// by which people find the machine.
    #[serde(default)]
    pub tags: Vec<String>,
    /// address of a still picture or of MJPEG; empty: none.
    #[serde(default)]
    pub camera: String,
    /// instruments that may command, such as `opcua`; others only show the machine.
    #[serde(default)]
    pub orders_from: Vec<String>,
}

/// What the machine and its service are: an `Info`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct InfoRequest {}

/// One input.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct InputInfo {
    pub name: String,
    /// within its kind, as M66 names it.
    pub number: u64,
    pub kind: ChannelKind,
    #[serde(default)]
    pub unit: String,
    /// of a real input; empty: it is simulated.
    #[serde(default)]
    pub source: String,
    /// it can hold the programs, or stop the machine.
    #[serde(default)]
    pub hold: bool,
    /// it can hold the programs, or stop the machine.
    #[serde(default)]
    pub stop: bool,
}

/// An input: its value (digital: 0, 1), and whether it holds the programs or stops the machine now.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct InputStatus {
    pub name: String,
    pub value: f64,
    #[serde(default)]
    pub holds: bool,
    #[serde(default)]
    pub stops: bool,
}

/// The jog's program id: for `abort`, and for keeping it alive.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JogReply {
    pub program: String,
}

/// Moves one axis by hand.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JogRequest {
    pub axis: u64,
    /// from where it is, signed \[mm, deg\]; none: until stopped or the limit, by the sign of `velocity`.
    pub distance: Option<f64>,
    /// \[mm/s, deg/s\]; none: a tenth of the axis's limit.
    pub velocity: Option<f64>,
    /// dead-man timeout: the axis stops unless the same jog is requested again within it; none: no timeout. A
    /// jog without distance always has one (default 0.5 s).
    pub hold_s: Option<f64>,
    /// id of the running jog that this request keeps alive.
    pub program: Option<String>,
    /// the person, if a client serves several: steps of one person follow each other, those of another person
    /// are refused (MC512) while the axis moves.
    pub by: String,
}

impl JogRequest {
    /// All that may be left out is as the server has it.
    #[must_use]
    pub fn new(axis: u64) -> Self {
        Self {
            axis,
            distance: None,
            velocity: None,
            hold_s: None,
            program: None,
            by: String::new(),
        }
    }
}

/// An assertion as the run keeps to it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Judged {
    /// of the assertion.
    pub what: Quantity,
    /// of the assertion.
    pub of: String,
    /// of the assertion.
    #[serde(deserialize_with = "Option::deserialize")]
    pub least: Option<f64>,
    /// of the assertion.
    #[serde(deserialize_with = "Option::deserialize")]
    pub most: Option<f64>,
    /// whether the run keeps to it.
    pub holds: bool,
    /// the extreme that counts; none: bodies stay farther apart than is reported.
    #[serde(deserialize_with = "Option::deserialize")]
    pub value: Option<f64>,
    /// when and in which line it has this value, or leaves the bounds of a position or speed.
    pub time_s: f64,
    /// when and in which line it has this value, or leaves the bounds of a position or speed.
    pub line: u64,
}

/// The client leaves: its open programs end now as their `on_disconnect` says, without a grace time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LeaveRequest {}

/// Bounds of the service.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LimitsInfo {
    pub max_line_length: u64,
    pub max_lines_a_message: u64,
    pub queue_lines: u64,
    pub programs_at_once: u64,
    pub open_programs: u64,
    pub remembered_answers: u64,
    pub remembered_answer_s: f64,
}

/// Time of one line that has ended.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LineReport {
    pub line: u64,
    /// executor time \[s\].
    pub start_s: f64,
    /// executor time \[s\].
    pub end_s: f64,
    /// none if the line requests no time.
    #[serde(default)]
    pub requested_s: Option<f64>,
    /// actual / requested; none without a requested time.
    #[serde(default)]
    pub stretched_by: Option<f64>,
    /// the limit that stretched it, such as `axis 2 acceleration`.
    #[serde(default)]
    pub bound_by: Option<String>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MachineFileReply {
    /// of the file, without its folder.
    pub name: String,
    /// as it is on the disk now.
    pub text: String,
    /// of that text.
    pub sha256: String,
    /// the server runs with this text; otherwise it has changed since the start.
    pub in_force: bool,
}

/// The machine file that the server was started with.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MachineFileRequest {}

/// Payload of `tele/state` and reply of `status`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MachineStatus {
    /// executor time \[s\].
    pub t: f64,
    /// Unix time of `t` \[s\].
    pub wall: f64,
    pub instance: String,
    pub state: MachineState,
    pub axes: AxesStatus,
    pub programs: Vec<ProgramStatus>,
    pub faults: Vec<Fault>,
    /// machine-wide feed override \[%\].
    #[serde(rename = "override", default = "machine_status_override")]
    pub override_percent: f64,
    /// cycles that began too late, since the start.
    #[serde(default)]
    pub late_cycles: u64,
    #[serde(default)]
    pub tools: Vec<ToolPose>,
    /// those of the machine file, in the order of `info`.
    #[serde(default)]
    pub inputs: Vec<InputStatus>,
    /// those of the machine file, in the order of `info`.
    #[serde(default)]
    pub outputs: Vec<OutputStatus>,
    #[serde(default)]
    pub probe: Option<ProbeStatus>,
    /// systems that were set, with which the next program starts (G54 is in force then).
    #[serde(default)]
    pub work_offsets: Vec<WorkOffset>,
    /// how slow the disk under the journal is; none: it keeps up.
    #[serde(default)]
    pub disk: Option<DiskStatus>,
    /// tools that have bodies and are known to be mounted.
    #[serde(default)]
    pub mounted: Vec<MountedTool>,
    /// mesh in force where G29 probes one: none, that of the machine file, or the probed one; none: G29 does
    /// not probe.
    #[serde(default)]
    pub bed_mesh: Option<BedMeshState>,
}

fn machine_status_override() -> f64 {
    100.0
}

/// A mesh that the URDF names: `name` as written there; `size` in bytes, 0: it is not available.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MeshInfo {
    pub name: String,
    pub size: u64,
}

/// A body or zone of `\[clearance\]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ModelBody {
    pub name: String,
    /// `box` (of a zone too), `cylinder`, `capsule`, `sphere`, `mesh` or `cutter`.
    pub shape: String,
    /// edges of a box, radius and length of a round shape.
    pub size_mm: Vec<f64>,
    /// in the frame of its carrier, Rz(C)·Ry(B)·Rx(A).
    pub at_mm: Vec<f64>,
    /// in the frame of its carrier, Rz(C)·Ry(B)·Rx(A).
    pub turned_deg: Vec<f64>,
    /// its index in `ModelReply.meshes`; the file is in mm.
    #[serde(default)]
    pub mesh: Option<u64>,
    /// of the URDF that carries it.
    #[serde(default)]
    pub link: String,
    /// axes that carry it instead
    #[serde(default)]
    pub carried_by: Vec<u64>,
    /// of these, 0 to 2 for X to Z.
    #[serde(default)]
    pub directions: Vec<u64>,
    /// in their negative direction. Neither: it is fixed.
    #[serde(default)]
    pub opposite: bool,
    /// with which it is mounted; none: it is always there.
    #[serde(default)]
    pub tool: Option<u64>,
    /// `keep_out`, `keep_in` or `slow`; empty: a body.
    #[serde(default)]
    pub zone: String,
    /// name of the input that switches it on; empty: it is always on.
    #[serde(default)]
    pub input: String,
    /// the input's level then.
    #[serde(default)]
    pub high: bool,
}

/// Part of a mesh's file: `mesh` counts from 0 in `ModelReply.meshes`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ModelMeshRequest {
    pub mesh: u64,
    pub offset: u64,
    pub size: u64,
}

impl ModelMeshRequest {
    /// All that may be left out is as the server has it.
    #[must_use]
    pub fn new(mesh: u64) -> Self {
        Self {
            mesh,
            offset: 0,
            size: 1_048_576,
        }
    }
}

/// `data` from `offset` on; `size` of the whole file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ModelPart {
    pub offset: u64,
    pub size: u64,
    pub data: Bytes,
}

/// A robot's URDF, and the bodies and zones of a machine.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ModelReply {
    /// its text; empty: the machine has none.
    pub urdf: String,
    /// of the text and the meshes.
    pub digest: String,
    /// the joint that each axis moves, by axis number.
    pub joints: BTreeMap<String, String>,
    /// of the visuals, followed by those of bodies, in the order of `ModelMeshRequest.mesh`.
    pub meshes: Vec<MeshInfo>,
    #[serde(default)]
    pub bodies: Vec<ModelBody>,
}

/// What the machine looks like: a `ModelReply`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ModelRequest {}

/// A value of a drive: of an object that `monitor` in the machine file names, or of its own telemetry.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MonitoredValue {
    pub name: String,
    /// the newest one; none: none has come yet.
    #[serde(deserialize_with = "Option::deserialize")]
    pub value: Option<Value>,
    /// the object; index 0: it is telemetry.
    #[serde(default)]
    pub index: u64,
    /// the object; index 0: it is telemetry.
    #[serde(default)]
    pub subindex: u64,
}

/// A tool that has a body and is mounted, according to a program.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MountedTool {
    pub number: u64,
    /// it is the cutter in the spindle, with `length` and `diameter` of the tool table \[mm\]; otherwise both
    /// are 0.
    pub spindle: bool,
    pub length: f64,
    pub diameter: f64,
}

/// What has to be resolved before a program starts at a line: code, message and remedy.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Need {
    pub code: String,
    pub message: String,
    pub hint: String,
    /// field of the request that confirms it, `way` or `outputs`; empty: it cannot be confirmed.
    #[serde(default)]
    pub confirm: String,
}

/// Frames of a node that were counted while a bus was listened to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NodeHealth {
    pub node: u64,
    /// numbers of the machine's axes that the node has.
    pub axes: Vec<u64>,
    /// NMT state in the last heartbeat; empty: none came.
    #[serde(default)]
    pub state: String,
    /// number of heartbeats.
    #[serde(default)]
    pub heartbeats: u64,
    /// longest time between two of them, by this computer's clock \[s\].
    #[serde(default)]
    pub longest_gap_s: f64,
    /// number of TPDOs that the node sends at SYNC.
    #[serde(default)]
    pub readings: u64,
    /// number of those that came after the next SYNC.
    #[serde(default)]
    pub late: u64,
    /// number of those that never came.
    #[serde(default)]
    pub lost: u64,
    /// number of its boot-up messages.
    #[serde(default)]
    pub boot_ups: u64,
    /// its last emergency messages in words.
    #[serde(default)]
    pub emergencies: Vec<String>,
}

/// The program's id; `expected` is the next line number, `credit` how many lines fit now.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OpenReply {
    pub program: String,
    pub state: ProgramState,
    pub axes: Vec<u64>,
    pub expected: u64,
    pub credit: u64,
    pub instance: String,
}

/// Opens a program.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OpenRequest {
    /// for people: a file's name.
    pub name: String,
    /// the axes to lease; none: all of the machine.
    pub axes: Option<Vec<u64>>,
    /// what happens when the client's liveliness token disappears, or it calls `leave`.
    pub on_disconnect: OnDisconnect,
    /// how long the token may be absent before that; a client that returns in this time continues.
    pub grace_s: f64,
    /// number of the first line that will run.
    pub start_line: u64,
    /// lines 1 … start_line - 1. They do not run; the axes move to where these lines end, energized, in the
    /// modal state that they leave.
    pub before: Vec<String>,
    /// id of an earlier program; its journaled lines before `start_line` serve as `before`.
    pub resume_of: Option<String>,
    /// single-line mode: a line starts only on a `step` call.
    pub step: bool,
    /// begin held; `resume` starts it.
    pub hold: bool,
    /// of the whole text; its times, from `simulate` or `put_text`, are used for the program.
    pub sha256: Option<String>,
    /// run now, also on axes of a program that is at a pause, such as to set zero with a new tool; refused
    /// (MC512) if it would have to wait. Without it a program waits for the other's end.
    pub at_pause: bool,
    /// of a start in the middle, as in `ContinueRequest`.
    pub way: bool,
    /// of a start in the middle, as in `ContinueRequest`.
    pub outputs: Option<Outputs>,
    /// lines that begin with `/` are skipped, until the program ends; none: they are executed as if it were
    /// not there, but `resume_of` keeps its setting (D-98).
    pub block_delete: Option<bool>,
    /// whether M01 pauses; none: it does, but `resume_of` keeps its setting.
    pub optional_stop: Option<bool>,
}

impl Default for OpenRequest {
    /// All that may be left out is as the server has it.
    fn default() -> Self {
        Self {
            name: String::new(),
            axes: None,
            on_disconnect: OnDisconnect::Stop,
            grace_s: 10.0,
            start_line: 1,
            before: Vec::new(),
            resume_of: None,
            step: false,
            hold: false,
            sha256: None,
            at_pause: false,
            way: false,
            outputs: None,
            block_delete: None,
            optional_stop: None,
        }
    }
}

/// One output.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OutputInfo {
    pub name: String,
    /// within its kind, as M62 to M68 name it.
    pub number: u64,
    pub kind: ChannelKind,
    #[serde(default)]
    pub unit: String,
    /// of a real output; empty: it is simulated.
    #[serde(default)]
    pub target: String,
    /// least and greatest value.
    #[serde(default)]
    pub min: f64,
    /// least and greatest value.
    #[serde(default = "output_info_max")]
    pub max: f64,
    /// its value once its setter is lost; none: it stays.
    #[serde(default)]
    pub safe: Option<f64>,
}

fn output_info_max() -> f64 {
    1.0
}

/// An output: its value (digital: 0, 1), and who set it last: a program's id, `operator` or nobody (empty).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OutputStatus {
    pub name: String,
    pub value: f64,
    #[serde(default)]
    pub set_by: String,
}

/// The override now in force \[%\].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OverrideReply {
    pub percent: f64,
    pub programs: Vec<String>,
}

/// Feed override of one program or of all, including future ones; 100 is as programmed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OverrideRequest {
    pub percent: f64,
    pub program: Option<String>,
}

impl OverrideRequest {
    /// All that may be left out is as the server has it.
    #[must_use]
    pub fn new(percent: f64) -> Self {
        Self {
            percent,
            program: None,
        }
    }
}

/// How near two `bodies` came to each other, when, and in which line.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PairClearance {
    pub bodies: Vec<String>,
    pub least_mm: f64,
    pub time_s: f64,
    pub line: u64,
}

/// An object of a drive, as its EDS describes it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ParameterInfo {
    pub index: u64,
    pub subindex: u64,
    /// name in the EDS; a member's follows that of its record: `Gear ratio.Motor revolutions`.
    pub name: String,
    /// data type.
    #[serde(rename = "type")]
    pub kind: SdoType,
    /// ro, wo, rw, rwr, rww or const.
    pub access: String,
    /// limits in the EDS; none: the limits of the type.
    #[serde(default)]
    pub low: Option<u64>,
    /// limits in the EDS; none: the limits of the type.
    #[serde(default)]
    pub high: Option<u64>,
}

/// The last probing move that has ended (G38.2 to G38.5).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ProbeStatus {
    pub program: String,
    pub line: u64,
    /// the probe changed.
    pub tripped: bool,
    /// where the axes were then, else where the move ended, by number \[mm, deg\]: machine positions,
    /// independent of the program's offsets.
    pub positions: BTreeMap<String, f64>,
    /// executor time \[s\].
    pub t: f64,
}

/// hold, resume, abort: one program, or every one (none).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Default)]
pub struct ProgramRequest {
    pub program: Option<String>,
}

/// One program.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ProgramStatus {
    pub program: String,
    pub state: ProgramState,
    pub client: String,
    pub name: String,
    pub axes: Vec<u64>,
    pub start_line: u64,
    /// the line being run, at a pause the one that asks for it; 0: none yet.
    pub line: u64,
    pub accepted: u64,
    pub done: u64,
    pub credit: u64,
    pub closed: bool,
    #[serde(rename = "override")]
    pub override_percent: f64,
    /// share of its time that has passed, 0 … 1; if `duration_s` is unknown, of its lines.
    pub progress: f64,
    /// Unix time \[s\].
    pub opened_at: f64,
    /// until its end at its override \[s\]; if `duration_s` is unknown, until the end of what is planned.
    #[serde(default)]
    pub eta_s: Option<f64>,
    #[serde(default)]
    pub fault: Option<Fault>,
    #[serde(default)]
    pub rejected: u64,
    #[serde(default)]
    pub diagnostics: Vec<Diagnostic>,
    #[serde(default)]
    pub resume_of: Option<String>,
    /// Unix time \[s\].
    #[serde(default)]
    pub ended_at: Option<f64>,
    /// of the whole program at 100 %, as its text was simulated \[s\]; none: not simulated.
    #[serde(default)]
    pub duration_s: Option<f64>,
    /// its last message to the operator; while it is paused, what to do before it is resumed.
    #[serde(default)]
    pub notice: String,
    /// share of its lines that the simulation has reached; below 1 `duration_s` is an estimate from the lines
    /// so far.
    #[serde(default = "program_status_simulated")]
    pub simulated: f64,
    /// how many of its remaining lines wait for an operator, as far as simulated; `eta_s` excludes these
    /// waits.
    #[serde(default)]
    pub pauses: u64,
    /// the input that M66, or a code of `\[dialect.waits\]`, waits for, the inputs that hold it (docs/io.md),
    /// or the program that must leave first (docs/clearance.md); empty: none.
    #[serde(default)]
    pub waits_for: String,
    /// as in `Ack`; 0 in programs of an earlier start of the server.
    #[serde(default)]
    pub rejections: u64,
    /// of a program in servo mode; none: it is not in servo mode.
    #[serde(default)]
    pub servo: Option<ServoStatus>,
    /// as in `Ack`.
    #[serde(default)]
    pub reason: String,
    /// as in `OpenRequest`; none: a program of an earlier start of the server (`continuation` reports them).
    #[serde(default)]
    pub block_delete: Option<bool>,
    /// as in `OpenRequest`; none: a program of an earlier start of the server (`continuation` reports them).
    #[serde(default)]
    pub optional_stop: Option<bool>,
}

fn program_status_simulated() -> f64 {
    1.0
}

/// Newest first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ProgramsReply {
    pub programs: Vec<ProgramStatus>,
}

/// The programs that the server knows, the newest first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ProgramsRequest {
    /// only this one.
    pub program: Option<String>,
    /// those that have ended too.
    pub ended: bool,
    pub limit: u64,
}

impl Default for ProgramsRequest {
    /// All that may be left out is as the server has it.
    fn default() -> Self {
        Self {
            program: None,
            ended: true,
            limit: 100,
        }
    }
}

/// How much of the text has arrived: the next part begins at `received`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PutTextReply {
    /// of the text \[bytes\].
    pub received: u64,
    /// in this part of it.
    pub lines: u64,
    /// all of it has arrived.
    pub complete: bool,
}

/// The next part of a program's text, for `check`, and for the times of programs that run it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PutTextRequest {
    /// of the whole text in UTF-8.
    pub sha256: String,
    /// of the whole text \[bytes\].
    pub size: u64,
    /// where the part begins \[bytes\].
    pub offset: u64,
    /// its bytes; characters may be split.
    pub part: Bytes,
}

impl PutTextRequest {
    /// All that may be left out is as the server has it.
    #[must_use]
    pub fn new(sha256: impl Into<String>, size: u64, offset: u64, part: Bytes) -> Self {
        Self {
            sha256: sha256.into(),
            size,
            offset,
            part,
        }
    }
}

/// The recording's name.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecordReply {
    pub name: String,
}

/// Saves the black box, the last minutes. `reason` is in the file and in its name.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecordSaveRequest {
    pub reason: String,
}

impl Default for RecordSaveRequest {
    /// All that may be left out is as the server has it.
    fn default() -> Self {
        Self {
            reason: "asked".to_owned(),
        }
    }
}

/// Records every cycle into a file on the server from now on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Default)]
pub struct RecordStartRequest {
    /// of the recording; empty: the time.
    pub name: String,
    /// when it ends by itself; none: only when it is stopped.
    pub max_s: Option<f64>,
}

/// Ends a recording; without a name the only one. The reply comes once the file is complete.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Default)]
pub struct RecordStopRequest {
    pub name: String,
}

/// The recorder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecorderStatus {
    /// of the black box in memory.
    pub held_s: f64,
    /// of the black box in memory.
    pub held_bytes: u64,
    /// since the start; the recorder came too late for them.
    pub missed_cycles: u64,
    /// names of the recordings under way.
    pub writing: Vec<String>,
}

/// A recording on the server's disk.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecordingInfo {
    /// without a suffix.
    pub name: String,
    /// `blackbox` was written by itself or by `record_save`.
    pub kind: RecordingKind,
    /// `unfinished` was left by a recorder that was killed, and is repaired at the next start.
    pub state: RecordingState,
    /// bytes.
    pub size: u64,
    /// Unix time \[s\].
    pub modified_at: f64,
}

/// Bytes of a recording from `offset` on; `size` is the whole file's.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecordingPart {
    pub name: String,
    pub offset: u64,
    pub size: u64,
    pub data: Bytes,
}

/// Part of a recording's file, for a download in parts; answered with a `RecordingPart`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecordingReadRequest {
    pub name: String,
    pub offset: u64,
    pub size: u64,
}

impl RecordingReadRequest {
    /// All that may be left out is as the server has it.
    #[must_use]
    pub fn new(name: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            offset: 0,
            size: 1_048_576,
        }
    }
}

/// The newest first; `recorder` none: it is not running. `folder`: on the server's disk.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecordingsReply {
    pub recordings: Vec<RecordingInfo>,
    #[serde(deserialize_with = "Option::deserialize")]
    pub recorder: Option<RecorderStatus>,
    pub folder: String,
}

/// Lists the recordings.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecordingsRequest {}

/// Sets the positions of axes, by number as text \[mm, deg\]; nothing moves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ReferenceRequest {
    pub positions: BTreeMap<String, f64>,
}

impl ReferenceRequest {
    /// All that may be left out is as the server has it.
    #[must_use]
    pub fn new(positions: BTreeMap<String, f64>) -> Self {
        Self {
            positions,
        }
    }
}

/// Rejects a run; its client is shown the reason. An approval for a while that was given with it ends.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RejectRequest {
    /// of the text, or at least its first 8 digits.
    pub sha256: String,
    pub reason: String,
    /// as in `ArmRequest`.
    pub number: Option<u64>,
}

impl RejectRequest {
    /// All that may be left out is as the server has it.
    #[must_use]
    pub fn new(sha256: impl Into<String>) -> Self {
        Self {
            sha256: sha256.into(),
            reason: String::new(),
            number: None,
        }
    }
}

/// Clears a latched fault or emergency stop; axes stay de-energized until captured (G1010).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Default)]
pub struct ResetRequest {
    pub axes: Option<Vec<u64>>,
}

/// Runs whose envelope was approved for a while (`standing_s`), each with its `remaining_s`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunApprovalsRequest {}

/// The program that was started.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunArmedReply {
    pub program: String,
    #[serde(rename = "override")]
    pub override_percent: f64,
}

/// Starts an armed program; the text is exactly that of the request.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunArmedRequest {
    pub text: String,
    /// as in `OpenRequest`.
    pub grace_s: f64,
}

impl RunArmedRequest {
    /// All that may be left out is as the server has it.
    #[must_use]
    pub fn new(text: impl Into<String>) -> Self {
        Self {
            text: text.into(),
            grace_s: 10.0,
        }
    }
}

/// Simulated path of a request, sampled at equal intervals, for a picture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunPath {
    /// n moments after the start of the run \[s\].
    pub time_s: Vec<f64>,
    /// for each axis of the request n setpoints \[mm or deg\].
    pub positions: Vec<Vec<f64>>,
    /// paths of the tools that these axes move.
    pub tools: Vec<ToolPath>,
}

/// A request with its text and the path of its simulation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunPreviewReply {
    pub run: RunRequestStatus,
    pub text: String,
    pub path: RunPath,
    /// what `mcserver certify` signs of it, as JSON: the initial state of its simulation, and a digest of its
    /// setpoints.
    pub certifiable: String,
    /// of its check and simulation, the first ones
    #[serde(default)]
    pub warnings: Vec<Diagnostic>,
    /// how many more there were.
    #[serde(default)]
    pub unshown_warnings: u64,
}

/// What an operator reviews before arming: the text and its simulated path.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunPreviewRequest {
    /// of the text, or at least its first 8 digits.
    pub sha256: String,
}

impl RunPreviewRequest {
    /// All that may be left out is as the server has it.
    #[must_use]
    pub fn new(sha256: impl Into<String>) -> Self {
        Self {
            sha256: sha256.into(),
        }
    }
}

/// `ok` false: the text has faults, and nothing waits. `run`: what an operator is shown.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunRequestReply {
    pub ok: bool,
    pub diagnostics: Vec<Diagnostic>,
    #[serde(default)]
    pub run: Option<RunRequestStatus>,
}

/// Requests a run of a text. It is checked and simulated, and moves nothing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunRequestRequest {
    /// the program.
    pub text: String,
    /// for people.
    pub name: String,
    /// the only axes that it may move; none: those named in the text.
    pub axes: Option<Vec<u64>>,
    /// a file of `mcserver certify` for exactly this run, which arms it; none: a person must.
    pub certificate: Option<String>,
    /// as in `OpenRequest`, and part of what is approved; a certificate has its own.
    pub block_delete: Option<bool>,
    /// as in `OpenRequest`, and part of what is approved; a certificate has its own.
    pub optional_stop: Option<bool>,
}

impl RunRequestRequest {
    /// All that may be left out is as the server has it.
    #[must_use]
    pub fn new(text: impl Into<String>) -> Self {
        Self {
            text: text.into(),
            name: String::new(),
            axes: None,
            certificate: None,
            block_delete: None,
            optional_stop: None,
        }
    }
}

/// A request: what would move, how far, how long; `remaining_s` until it or its arming is over.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunRequestStatus {
    pub sha256: String,
    pub client: String,
    pub name: String,
    pub state: RunState,
    pub axes: Vec<u64>,
    pub duration_s: f64,
    pub extents: Vec<Extent>,
    pub remaining_s: f64,
    #[serde(rename = "override")]
    pub override_percent: f64,
    /// who armed or rejected it.
    pub operator: String,
    /// those of the run, as in `OpenRequest`.
    pub block_delete: bool,
    /// those of the run, as in `OpenRequest`.
    pub optional_stop: bool,
    /// a new one each time that the run is requested, even with the same text.
    #[serde(default)]
    pub number: u64,
    /// why it was rejected.
    #[serde(default)]
    pub reason: String,
    /// what the run leaves changed for later runs, a sentence each.
    #[serde(default)]
    pub effects: Vec<String>,
    /// extents of the tools' tips.
    #[serde(default)]
    pub tools: Vec<ToolExtent>,
    /// SHA-256 of everything that the simulation read.
    #[serde(default)]
    pub digest: String,
    /// which of this has changed since, a sentence each; if there is any it cannot start.
    #[serde(default)]
    pub changed: Vec<String>,
    /// hash of the approval for a while that has armed it; the run stays inside its envelope.
    #[serde(default)]
    pub approval: String,
    /// what of the run is outside the envelope approved for its client, a sentence each.
    #[serde(default)]
    pub beyond: Vec<String>,
    /// it is approved for a while, for streamed targets, too.
    #[serde(default)]
    pub servo: bool,
}

/// The oldest first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunRequestsReply {
    pub requests: Vec<RunRequestStatus>,
}

/// Requests that wait for an operator, are armed, or were started recently.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunRequestsRequest {}

/// A node that answers on a bus.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ScannedNode {
    /// node number; on EtherCAT the position on the line.
    pub node: u64,
    /// number of the device profile, from 1000h.
    pub profile: u64,
    /// the same in words.
    pub what: String,
    /// identity 1018h; none: the node did not give it.
    #[serde(default)]
    pub vendor_id: Option<u64>,
    /// identity 1018h; none: the node did not give it.
    #[serde(default)]
    pub product_code: Option<u64>,
    /// identity 1018h; none: the node did not give it.
    #[serde(default)]
    pub revision: Option<u64>,
    /// identity 1018h; none: the node did not give it.
    #[serde(default)]
    pub serial: Option<u64>,
    /// modes of operation that 6502h lists.
    #[serde(default)]
    pub modes: Vec<String>,
    /// axis of the running machine that this drive moves; none: no axis has it.
    #[serde(default)]
    pub axis: Option<u64>,
    /// path of the EDS file in the machine file, or of one with this vendor and product; empty: none was
    /// found.
    #[serde(default)]
    pub eds: String,
    /// values of further objects, by keys such as `"6091:1"`: encoder (608Fh), gear (6091h), feed (6092h),
    /// rated torque (6076h \[mN·m\]), greatest motor speed (6080h \[1/min\]), travel limits (607Dh).
    #[serde(default)]
    pub objects: BTreeMap<String, u64>,
}

/// Values of an object in each cycle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ScopeSignal {
    /// index and subindex, such as `6064h:00`; empty: the values were computed.
    pub object: String,
    pub name: String,
    /// unit of the values; empty: the drive's own.
    pub unit: String,
    /// one for each cycle, float64, little endian; NaN: no value came in it.
    pub values: Bytes,
}

/// Reads an object of a drive's dictionary (CiA 301).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SdoReadRequest {
    /// of the object.
    pub index: u64,
    /// of the object.
    pub subindex: u64,
    /// whose drive; or `node`, with `bus` where several buses have that number.
    pub axis: Option<u64>,
    pub node: Option<u64>,
    pub bus: String,
    /// how to read the bytes; none: by the drive's EDS, or the standard's objects.
    #[serde(rename = "type")]
    pub kind: Option<SdoType>,
}

impl SdoReadRequest {
    /// All that may be left out is as the server has it.
    #[must_use]
    pub fn new(index: u64) -> Self {
        Self {
            index,
            subindex: 0,
            axis: None,
            node: None,
            bus: String::new(),
            kind: None,
        }
    }
}

/// Value of an object that was read or written.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SdoReply {
    pub axis: u64,
    pub bus: String,
    /// node number; on EtherCAT the position on the line.
    pub node: u64,
    pub index: u64,
    pub subindex: u64,
    #[serde(rename = "type")]
    pub kind: SdoType,
    /// of the type `bytes` as hexadecimal text.
    pub value: Value,
    /// the transferred bytes, little endian.
    pub raw: Bytes,
    /// kind of the bus.
    #[serde(default = "sdo_reply_fieldbus")]
    pub fieldbus: Fieldbus,
}

fn sdo_reply_fieldbus() -> Fieldbus {
    Fieldbus::Can
}

/// Writes an object; `value` may be text: a number such as `0x10`, or hexadecimal for `bytes`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SdoWriteRequest {
    pub index: u64,
    pub subindex: u64,
    pub axis: Option<u64>,
    pub node: Option<u64>,
    pub bus: String,
    #[serde(rename = "type")]
    pub kind: Option<SdoType>,
    pub value: Value,
}

impl SdoWriteRequest {
    /// All that may be left out is as the server has it.
    #[must_use]
    pub fn new(index: u64, value: Value) -> Self {
        Self {
            index,
            subindex: 0,
            axis: None,
            node: None,
            bus: String::new(),
            kind: None,
            value,
        }
    }
}

/// The program that follows targets, sent as `StreamTargets` on `in/{client}/{program}`; its axes in order.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ServoReply {
    pub program: String,
    pub axes: Vec<u64>,
}

/// Leases axes for targets that the client streams, and energizes them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Default)]
pub struct ServoRequest {
    /// the axes to lease, all free now; none: all of the machine.
    pub axes: Option<Vec<u64>>,
    /// for people.
    pub name: String,
    /// lowest position that targets may command, by axis number as text \[mm or deg\]; only together with
    /// `high`. A machine with bodies or zones needs both: if these would not stay clear everywhere between,
    /// the program ends as faulted and nothing moves.
    pub low: Option<BTreeMap<String, f64>>,
    /// highest position that targets may command, by axis number as text \[mm or deg\].
    pub high: Option<BTreeMap<String, f64>>,
}

/// The targets of a program in servo mode, counted since it was opened.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ServoStatus {
    /// messages accepted.
    pub taken: u64,
    /// numbers that never came, or came after later ones.
    pub lost: u64,
    /// came after their validity.
    pub late: u64,
    /// repeated the newest number, or had a lower one.
    pub doubled: u64,
    /// repeated the newest number, or had a lower one.
    pub reordered: u64,
    /// too far from the previous point, and not confirmed by the next one.
    pub jumped: u64,
    /// not finite, not of the program's axes, or a pose that the tool cannot reach.
    pub refused: u64,
    /// of those taken, beyond an axis's travel.
    pub clipped: u64,
    /// of those taken, faster than a tool's axes can go.
    pub slowed: u64,
    /// between messages, by the sender's clock.
    pub interval_s: f64,
    /// of the newest one, beyond the quickest.
    pub age_s: f64,
}

/// Sets a simulated input by its name, like `SetOutputRequest`; its script ends.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SetInputRequest {
    pub input: String,
    pub value: f64,
}

impl SetInputRequest {
    /// All that may be left out is as the server has it.
    #[must_use]
    pub fn new(input: impl Into<String>, value: f64) -> Self {
        Self {
            input: input.into(),
            value,
        }
    }
}

/// Sets an output by its name; digital: true and false, or 1 and 0.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SetOutputRequest {
    pub output: String,
    pub value: f64,
}

impl SetOutputRequest {
    /// All that may be left out is as the server has it.
    #[must_use]
    pub fn new(output: impl Into<String>, value: f64) -> Self {
        Self {
            output: output.into(),
            value,
        }
    }
}

/// The value that an input or output has from the next cycle on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SetReply {
    pub name: String,
    pub value: f64,
}

/// Names a row of the tables, or sets how long a tool may cut; what is nil stays.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SetTableRowRequest {
    /// `G54` to `G59.3`, or `T3`.
    pub row: String,
    /// for people; empty removes it.
    pub name: Option<String>,
    /// how long the tool may cut; 0: no limit.
    pub life_min: Option<f64>,
    /// how long it has cut, 0 when a new one is fitted.
    pub used_min: Option<f64>,
    /// the person, if a client serves several.
    pub by: String,
}

impl SetTableRowRequest {
    /// All that may be left out is as the server has it.
    #[must_use]
    pub fn new(row: impl Into<String>) -> Self {
        Self {
            row: row.into(),
            name: None,
            life_min: None,
            used_min: None,
            by: String::new(),
        }
    }
}

/// What `mcserver simulate --json` prints.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SimulateReply {
    pub ok: bool,
    pub duration_s: f64,
    pub feed_length_mm: f64,
    /// those that took time, by start.
    pub lines: Vec<LineReport>,
    /// by number as text.
    pub axes: BTreeMap<String, AxisTravel>,
    pub diagnostics: Vec<Diagnostic>,
    /// of the systems used or set.
    #[serde(default)]
    pub work_offsets: Vec<WorkOffset>,
    /// their values at the end, by name.
    #[serde(default)]
    pub inputs: BTreeMap<String, f64>,
    /// their values at the end, by name.
    #[serde(default)]
    pub outputs: BTreeMap<String, f64>,
    /// if it was requested.
    #[serde(default)]
    pub path: Option<SimulatedPath>,
    /// of a machine that names bodies.
    #[serde(default)]
    pub clearance: Option<ClearanceReport>,
    /// results of those of the request, in their order.
    #[serde(default)]
    pub assertions: Vec<Judged>,
    /// to the motion of `against`.
    #[serde(default)]
    pub difference: Option<Difference>,
}

/// Runs a program's text on a virtual clock and simulated drives.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SimulateRequest {
    pub text: String,
    /// start the axes there \[mm, deg\]; none: where the machine file starts simulated drives.
    pub positions: Option<BTreeMap<String, f64>>,
    /// maximum number of points in the reply's `path`; 0: no path.
    pub path_points: u64,
    /// whether the reply has the times of every line.
    pub lines: bool,
    /// are judged on every setpoint; one that does not hold is a fault (MC330).
    pub assertions: Vec<Assertion>,
    /// another program's text, from the same start: the reply has the `difference` to its motion.
    pub against: Option<String>,
    /// whose run it is: `agent`, one that a person approves, or `operator`, any other; zones of the other
    /// role do not count. none: all zones count.
    pub role: Option<RunRole>,
    /// as of `OpenRequest`.
    pub block_delete: Option<bool>,
    /// as of `OpenRequest`.
    pub optional_stop: Option<bool>,
}

impl SimulateRequest {
    /// All that may be left out is as the server has it.
    #[must_use]
    pub fn new(text: impl Into<String>) -> Self {
        Self {
            text: text.into(),
            positions: None,
            path_points: 0,
            lines: true,
            assertions: Vec::new(),
            against: None,
            role: None,
            block_delete: None,
            optional_stop: None,
        }
    }
}

/// Points at equal distances along the axes' travel.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SimulatedPath {
    /// the program's line at each point.
    pub lines: Vec<u64>,
    /// the points of each tool.
    pub tips: Vec<TipPath>,
}

/// The whole machine's state now: a `MachineStatus`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StatusRequest {}

/// Starts the next line of a program in single-line mode.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StepRequest {
    pub program: String,
}

impl StepRequest {
    /// All that may be left out is as the server has it.
    #[must_use]
    pub fn new(program: impl Into<String>) -> Self {
        Self {
            program: program.into(),
        }
    }
}

/// Cumulative: lines through `accepted` are accepted, through `done` have ended; `credit` more fit.
/// `rejections`: how many the program has had.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SubmitReply {
    pub program: String,
    pub accepted: u64,
    pub done: u64,
    pub credit: u64,
    #[serde(default)]
    pub rejections: u64,
}

/// Lines `first`, `first + 1`, …; without `judge` the reply does not wait for the verdict. `rejections`: how
/// many the client knows of; lines from before a rejection are refused. none: unknown, the lines are taken as
/// current.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SubmitRequest {
    pub program: String,
    pub first: u64,
    pub lines: Vec<String>,
    pub judge: bool,
    pub rejections: Option<u64>,
}

impl SubmitRequest {
    /// All that may be left out is as the server has it.
    #[must_use]
    pub fn new(program: impl Into<String>, first: u64, lines: Vec<String>) -> Self {
        Self {
            program: program.into(),
            first,
            lines,
            judge: true,
            rejections: None,
        }
    }
}

/// An output, or the speed or torque of an axis, that differs from its value in the program.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Switched {
    /// of the output, or such as `axis 3`.
    pub name: String,
    /// value in the program before the line.
    pub there: f64,
    /// present value.
    pub now: f64,
    /// of both values.
    #[serde(default)]
    pub unit: String,
}

/// Who changed a row of the tables; what one program does to one row in turn is one change.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TableChange {
    /// Unix time \[s\].
    pub wall: f64,
    /// whose program it was.
    pub client: String,
    /// its id.
    pub program: String,
    /// of the program.
    pub name: String,
    /// `G54` to `G59.3`, or `T3`.
    pub row: String,
    /// by axis number, `R` of a turned system, or `length` and `diameter` \[m, rad; in messages mm, deg\];
    /// empty: the row was not there. Or a tool's `life` and what it has `used` \[s; in messages min\].
    pub before: BTreeMap<String, f64>,
    /// by axis number, `R` of a turned system, or `length` and `diameter` \[m, rad; in messages mm, deg\];
    /// empty: the row was not there. Or a tool's `life` and what it has `used` \[s; in messages min\].
    pub after: BTreeMap<String, f64>,
    /// its name before and after, where that was changed.
    #[serde(default)]
    pub was_called: String,
    /// its name before and after, where that was changed.
    #[serde(default)]
    pub called: String,
}

/// The tables that programs start with, and who changed them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Tables {
    /// systems that were set; the others read zero at the machine's zero.
    pub offsets: Vec<WorkOffset>,
    /// whether the machine's programs have one, with G43 and G10 L1.
    pub tool_table: bool,
    /// in the order of their numbers.
    pub tools: Vec<ToolRow>,
    /// the newest first.
    pub changes: Vec<TableChange>,
    /// of systems, by system.
    #[serde(default)]
    pub names: BTreeMap<String, String>,
}

/// The tables that programs start with.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TablesRequest {}

/// How to read `tele/batch`: its columns, its fields and the maximum of cycles in a message.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TelemetryInfo {
    pub axes: Vec<u64>,
    pub fields: Vec<String>,
    pub cycles_a_message: u64,
    pub state_hz: f64,
}

/// How far apart two paths of a tip are, whatever their times.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TipDifference {
    /// none: the axes 0, 1 and 2 themselves.
    #[serde(deserialize_with = "Option::deserialize")]
    pub tool: Option<u64>,
    /// the greatest distance of a point of one path from the other one.
    pub apart_mm: f64,
    /// where that is.
    pub time_s: f64,
    /// where that is.
    pub line: u64,
    /// they are of the other program, whose path goes astray there.
    pub other: bool,
}

/// Where a tool goes \[mm\]; `tool` none: the axes 0, 1 and 2 themselves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TipPath {
    #[serde(deserialize_with = "Option::deserialize")]
    pub tool: Option<u64>,
    pub points: Vec<Vec<f64>>,
}

/// Least and greatest X, Y and Z of a tool's tip in the base frame \[mm\], and its greatest speed \[mm/s\].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ToolExtent {
    pub tool: u64,
    pub low: Vec<f64>,
    pub high: Vec<f64>,
    pub speed: f64,
}

/// One tool of G01 … Tn.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ToolInfo {
    pub number: u64,
    pub frame: String,
    pub axes: Vec<u64>,
    pub orientation: bool,
    pub euler: String,
    /// the frame of its poses; empty: the base.
    #[serde(default)]
    pub work: String,
}

/// The jog's program, for `abort` and for keeping it alive.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ToolJogReply {
    pub program: String,
    /// which joint ends the motion, and why, for people; empty: nothing within the tool's reach, or the jog
    /// was kept alive.
    #[serde(default)]
    pub obstacle: String,
}

/// Moves a tool's tip in a straight line, by all its joints, until it is stopped or cannot continue.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ToolJogRequest {
    /// number of the machine file.
    pub tool: u64,
    /// X Y Z to move along that axis of `frame`, A B C to turn about it with the tip at rest.
    pub word: ToolDirection,
    /// of the tip \[mm/s\], of a turn \[deg/s\], signed. Near a singular position, and where a joint's limit
    /// is lower, it is slower.
    pub velocity: f64,
    /// the base, or the tool itself.
    pub frame: ToolFrame,
    /// dead-man timeout, as in `jog` (default 0.5 s).
    pub hold_s: Option<f64>,
    /// id of the running jog that this request keeps alive.
    pub program: Option<String>,
    /// the person, if a client serves several.
    pub by: String,
}

impl ToolJogRequest {
    /// All that may be left out is as the server has it.
    #[must_use]
    pub fn new(tool: u64, word: ToolDirection, velocity: f64) -> Self {
        Self {
            tool,
            word,
            velocity,
            frame: ToolFrame::Base,
            hold_s: None,
            program: None,
            by: String::new(),
        }
    }
}

/// Path of a tool; `position`: lists of X, of Y and of Z at the moments of the `RunPath` \[mm\].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ToolPath {
    pub tool: u64,
    pub position: Vec<Vec<f64>>,
}

/// Where a tool's frame is: `\[x, y, z\]` in mm, `\[a, b, c\]` in deg.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ToolPose {
    pub number: u64,
    pub position: Vec<f64>,
    pub orientation: Vec<f64>,
}

/// A line of the tool table \[mm\], for G43.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ToolRow {
    pub number: u64,
    pub length: f64,
    pub diameter: f64,
    /// by G10 L1, so that it differs from the machine file.
    #[serde(default)]
    pub changed: bool,
    #[serde(default)]
    pub name: String,
    /// how long it may cut; 0: not set.
    #[serde(default)]
    pub life_min: f64,
    /// how long it has cut, counted in G01 to G03 while its spindle turns.
    #[serde(default)]
    pub used_min: f64,
}

/// Gains of a control loop and its stability margins.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TunedLoop {
    pub name: String,
    /// by the keys of `\[axis.drive\]`.
    pub gains: BTreeMap<String, f64>,
    /// in mode cst the least and the greatest inertia, as multiples of the measured one, with which the loop
    /// is stable; in mode csv `greatest` alone, the multiple of its gain up to which it is stable; 0: it is
    /// not stable.
    pub least: f64,
    /// in mode cst the least and the greatest inertia, as multiples of the measured one, with which the loop
    /// is stable; in mode csv `greatest` alone, the multiple of its gain up to which it is stable; 0: it is
    /// not stable.
    pub greatest: f64,
    /// phase margin \[deg\].
    pub phase_deg: f64,
    /// crossover frequency \[Hz\] and phase margin \[deg\] on the measured response; none: not known.
    #[serde(default)]
    pub crossover_hz: Option<f64>,
    /// crossover frequency \[Hz\] and phase margin \[deg\] on the measured response; none: not known.
    #[serde(default)]
    pub measured_phase_deg: Option<f64>,
    /// multiple of the gains up to which the loop is stable on that response; none: more than could be
    /// measured.
    #[serde(default)]
    pub measured_gain: Option<f64>,
}

/// One step of an approach: a move of axes, or a wait for an input.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WayStep {
    /// description for people.
    pub text: String,
    /// end of the move, by axis number as text \[mm, deg\]; empty: no axis moves.
    #[serde(default)]
    pub targets: BTreeMap<String, f64>,
    /// each axis moves at its own limits; otherwise at the approach velocity.
    #[serde(default)]
    pub rapid: bool,
}

/// One fault of a program, placed in its text; `line` is the client's line number.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Diagnostic {
    pub code: String,
    pub message: String,
    #[serde(default)]
    pub line: u64,
    #[serde(default)]
    pub column: u64,
    #[serde(default)]
    pub end_column: u64,
    #[serde(default)]
    pub hint: String,
    #[serde(default = "diagnostic_severity")]
    pub severity: Severity,
    #[serde(default)]
    pub tool: Option<u64>,
    #[serde(default)]
    pub residual_mm: Option<f64>,
    #[serde(default)]
    pub axis: Option<u64>,
    #[serde(default)]
    pub edit: Option<Edit>,
}

fn diagnostic_severity() -> Severity {
    Severity::Error
}

/// Withdraws a request; only the user who made it may.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WithdrawRequest {
    /// of the text, or at least its first 8 digits.
    pub sha256: String,
}

impl WithdrawRequest {
    /// All that may be left out is as the server has it.
    #[must_use]
    pub fn new(sha256: impl Into<String>) -> Self {
        Self {
            sha256: sha256.into(),
        }
    }
}

/// The origin of a work coordinate system.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WorkOffset {
    /// such as `G54`.
    pub system: String,
    /// where the axes read zero, by number \[mm, deg\]; an axis that is omitted reads as the machine does.
    pub origin: BTreeMap<String, f64>,
    /// angle by which X and Y are turned about Z, counter-clockwise (G10 L2 R) \[deg\]: a single axis does
    /// not determine what they read then.
    #[serde(default)]
    pub rotation: f64,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WriteMachineFileReply {
    /// the new text is on the disk.
    pub written: bool,
    /// name of the file that keeps the old one; empty: none.
    pub before: String,
    /// errors and warnings of the new text.
    pub diagnostics: Vec<Diagnostic>,
}

/// Checks a text as `mcserver machine check` does, and writes it if it has no error. The server continues
/// with the old one until it is restarted.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WriteMachineFileRequest {
    /// all of the new file.
    pub text: String,
    /// of the text that was edited, as `machine_file` returned it.
    pub sha256: String,
    /// nothing is written.
    pub only_check: bool,
    /// the person, if a client serves several.
    pub by: String,
}

impl WriteMachineFileRequest {
    /// All that may be left out is as the server has it.
    #[must_use]
    pub fn new(text: impl Into<String>, sha256: impl Into<String>) -> Self {
        Self {
            text: text.into(),
            sha256: sha256.into(),
            only_check: false,
            by: String::new(),
        }
    }
}
