//! The machine: what it is, its state, its events.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::channels::{InputInfo, InputStatus, OutputInfo, OutputStatus};
use super::hundred;
use super::program::{Diagnostic, Fault, ProgramState, ProgramStatus};

/// All axes, column-wise: each list has one entry for each of `index`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct AxesStatus {
    /// Axis numbers.
    #[serde(default)]
    pub index: Vec<u64>,
    /// What the encoders say [mm, deg].
    #[serde(default)]
    pub position: Vec<f64>,
    /// [mm, deg]
    #[serde(default)]
    pub setpoint: Vec<f64>,
    /// [mm/s, deg/s]
    #[serde(default)]
    pub velocity: Vec<f64>,
    /// [N·m]
    #[serde(default)]
    pub torque: Vec<f64>,
    /// `off starting standstill moving speed torque stopping released fault`.
    #[serde(default)]
    pub state: Vec<String>,
    /// Whether its zero is known; empty where no axis has homing.
    #[serde(default)]
    pub homed: Vec<bool>,
}

/// Where the encoders say that a tool's frame is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ToolPose {
    /// The tool's number.
    pub number: u64,
    /// x, y, z [mm].
    pub position: Vec<f64>,
    /// a, b, c [deg].
    #[serde(default)]
    pub orientation: Vec<f64>,
}

/// The whole machine; `state` is `ready`, `fault` or `estop`, the latter two latched until reset.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MachineStatus {
    /// Executor time [s].
    pub t: f64,
    /// Unix time [s].
    pub wall: f64,
    /// The server's instance.
    pub instance: String,
    /// `ready`, `fault` or `estop`.
    pub state: String,
    /// All axes.
    pub axes: AxesStatus,
    /// Programs that have not ended, and those that ended lately.
    #[serde(default)]
    pub programs: Vec<ProgramStatus>,
    /// Latched faults.
    #[serde(default)]
    pub faults: Vec<Fault>,
    /// Feed override of the machine [%].
    #[serde(default = "hundred", rename = "override")]
    pub override_percent: f64,
    /// Cycles that came late.
    #[serde(default)]
    pub late_cycles: u64,
    /// Poses of the tools.
    #[serde(default)]
    pub tools: Vec<ToolPose>,
    /// Inputs, in the order of [`Info`].
    #[serde(default)]
    pub inputs: Vec<InputStatus>,
    /// Outputs, in the order of [`Info`].
    #[serde(default)]
    pub outputs: Vec<OutputStatus>,
    /// The last probing move that has ended.
    #[serde(default)]
    pub probe: Option<ProbeStatus>,
    /// Work coordinate systems that were set.
    #[serde(default)]
    pub work_offsets: Vec<WorkOffset>,
    /// How slow the disk under the journal is; none: it keeps up.
    #[serde(default)]
    pub disk: Option<DiskStatus>,
}

/// How slow the disk under the journal is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DiskStatus {
    /// Unix time from which on it is slow [s].
    pub since: f64,
    /// For how long what is to be said has waited for the journal's commit [s].
    pub commit_s: f64,
    /// How long the sync under way has taken [s].
    pub sync_s: f64,
    /// The longest of these since then [s].
    pub worst_s: f64,
}

/// The origin of a work coordinate system.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WorkOffset {
    /// Such as `G54`.
    pub system: String,
    /// Where it reads zero, by axis number [mm, deg].
    pub origin: BTreeMap<String, f64>,
}

/// Time of one line that has ended.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LineReport {
    /// Its number.
    pub line: u64,
    /// Executor time [s].
    pub start_s: f64,
    /// Executor time [s].
    pub end_s: f64,
    /// What it asked for [s].
    #[serde(default)]
    pub requested_s: Option<f64>,
    /// Actual over requested time.
    #[serde(default)]
    pub stretched_by: Option<f64>,
    /// The limit that slowed it down.
    #[serde(default)]
    pub bound_by: Option<String>,
}

/// The last probing move that has ended (G38.2 to G38.5).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ProbeStatus {
    /// The program's id.
    pub program: String,
    /// The line.
    pub line: u64,
    /// The probe changed.
    pub tripped: bool,
    /// Where the axes were then, else where the move ended, by number [mm, deg].
    pub positions: BTreeMap<String, f64>,
    /// Executor time [s].
    pub t: f64,
}

/// One event; `kind` says which fields are set (docs/wire/events.md).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Event {
    /// Number, without gap within one instance.
    pub seq: u64,
    /// Executor time [s].
    pub t: f64,
    /// The server's instance.
    pub instance: String,
    /// Such as `lines.ended`.
    pub kind: String,
    /// The program concerned.
    #[serde(default)]
    pub program: Option<String>,
    /// The client concerned.
    #[serde(default)]
    pub client: Option<String>,
    /// The program's state.
    #[serde(default)]
    pub state: Option<ProgramState>,
    /// The line concerned; 0: none.
    #[serde(default)]
    pub line: u64,
    /// Of `lines.ended`.
    #[serde(default)]
    pub lines: Vec<LineReport>,
    /// Of `fault` and `program.ended`.
    #[serde(default)]
    pub fault: Option<Fault>,
    /// Of `line.rejected`.
    #[serde(default)]
    pub diagnostics: Vec<Diagnostic>,
    /// Why, or a code.
    #[serde(default)]
    pub reason: String,
    /// One sentence.
    #[serde(default)]
    pub message: String,
    /// Of `override` [%].
    #[serde(default)]
    pub percent: Option<f64>,
    /// Of drives.
    #[serde(default)]
    pub axis: Option<u64>,
    /// Of a probing move that has ended.
    #[serde(default)]
    pub probe: Option<ProbeStatus>,
    /// Unix time of `t`, by the server's clock as it went then [s].
    #[serde(default)]
    pub wall: f64,
}

/// One axis; limits in mm or deg and seconds, none where not limited.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AxisInfo {
    /// Its number, 0 … 63.
    pub index: u64,
    /// `linear` or `rotary`.
    #[serde(rename = "type")]
    pub kind: String,
    /// `mm` or `deg`.
    pub unit: String,
    /// [mm/s, deg/s]
    #[serde(default)]
    pub max_velocity: f64,
    /// [mm/s², deg/s²]
    #[serde(default)]
    pub max_acceleration: f64,
    /// Kind of drive.
    #[serde(default)]
    pub drive: String,
    /// [mm/s³, deg/s³]
    #[serde(default)]
    pub max_jerk: Option<f64>,
    /// [mm, deg]
    #[serde(default)]
    pub min_position: Option<f64>,
    /// [mm, deg]
    #[serde(default)]
    pub max_position: Option<f64>,
    /// Exact-stop tolerance [mm, deg].
    #[serde(default)]
    pub in_position: f64,
    /// How its zero is found; none: it needs no homing.
    #[serde(default)]
    pub homing: Option<String>,
}

/// One tool of G01 … Tn.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ToolInfo {
    /// Its number.
    pub number: u64,
    /// Its frame in the URDF.
    pub frame: String,
    /// The chain's joints in order.
    #[serde(default)]
    pub axes: Vec<u64>,
    /// Whether A, B and C are allowed.
    #[serde(default)]
    pub orientation: bool,
    /// Order of the Euler angles.
    #[serde(default)]
    pub euler: String,
}

/// Columns and fields of the samples.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct TelemetryInfo {
    /// Columns.
    #[serde(default)]
    pub axes: Vec<u64>,
    /// `setpoint position velocity torque`.
    #[serde(default)]
    pub fields: Vec<String>,
    /// How many cycles a message holds at most.
    #[serde(default)]
    pub cycles_a_message: u64,
    /// How many states come a second.
    #[serde(default)]
    pub state_hz: f64,
}

/// Bounds of the service.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct LimitsInfo {
    /// Code points of a line.
    pub max_line_length: u64,
    /// Lines of a message.
    pub max_lines_a_message: u64,
    /// Lines that wait in the server.
    pub queue_lines: u64,
    /// Programs that run side by side.
    pub programs_at_once: u64,
    /// Programs that have not ended.
    pub open_programs: u64,
    /// Answers kept for each client.
    pub remembered_answers: u64,
    /// How long [s].
    pub remembered_answer_s: f64,
}

impl Default for LimitsInfo {
    fn default() -> Self {
        Self {
            max_line_length: 8192,
            max_lines_a_message: 20_000,
            queue_lines: 0,
            programs_at_once: 0,
            open_programs: 0,
            remembered_answers: 0,
            remembered_answer_s: 0.0,
        }
    }
}

/// The machine and the service.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Info {
    /// The machine's name.
    pub machine: String,
    /// The server's version.
    pub server: String,
    /// Versions of the key space that it speaks.
    pub protocol: Vec<u64>,
    /// One start of the server.
    pub instance: String,
    /// Unix time of t = 0 [s].
    pub epoch: f64,
    /// Period of the executor [s].
    pub cycle_s: f64,
    /// The axes.
    #[serde(default)]
    pub axes: Vec<AxisInfo>,
    /// The tools.
    #[serde(default)]
    pub tools: Vec<ToolInfo>,
    /// How samples are read.
    #[serde(default)]
    pub telemetry: TelemetryInfo,
    /// Bounds of the service.
    #[serde(default)]
    pub limits: LimitsInfo,
    /// Remote methods.
    #[serde(default)]
    pub methods: Vec<String>,
    /// Inputs of the machine file.
    #[serde(default)]
    pub inputs: Vec<InputInfo>,
    /// Outputs of the machine file.
    #[serde(default)]
    pub outputs: Vec<OutputInfo>,
}

/// Every fault of a text; `ok`: there is no error among them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CheckResult {
    /// No error.
    pub ok: bool,
    /// What was found.
    #[serde(default)]
    pub diagnostics: Vec<Diagnostic>,
}

/// Events again, by number.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EventPage {
    /// The server's instance.
    pub instance: String,
    /// The first that the server still has.
    pub oldest: u64,
    /// The last one published.
    pub newest: u64,
    /// In order.
    #[serde(default)]
    pub events: Vec<Event>,
}
