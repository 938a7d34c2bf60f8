//! Programs: lines, acknowledgements, faults, and the replies about them.

use std::collections::BTreeMap;
use std::fmt;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::hundred;

fn one() -> u64 {
    1
}

fn yes() -> bool {
    true
}

fn error_severity() -> String {
    "error".to_owned()
}

/// Where a program is in its life.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum ProgramState {
    /// Waits for its axes.
    #[default]
    Queued,
    /// Runs.
    Running,
    /// Feed hold.
    Held,
    /// M00 or M01.
    Paused,
    /// Aborted, coming to rest.
    Ending,
    /// Ended as programmed.
    Finished,
    /// Ended by an operator, or by the loss of its client's link.
    Aborted,
    /// Ended at a faulty line.
    Rejected,
    /// Ended by a fault of the machine.
    Faulted,
    /// The server that ran it went away.
    Interrupted,
    /// A word of a later version of the protocol.
    #[serde(untagged)]
    Later(String),
}

impl ProgramState {
    /// Whether the program has ended, well or not.
    #[must_use]
    pub fn is_end(&self) -> bool {
        use ProgramState::{Aborted, Faulted, Finished, Interrupted, Rejected};
        matches!(self, Finished | Aborted | Rejected | Faulted | Interrupted)
    }
}

impl fmt::Display for ProgramState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Queued => "queued",
            Self::Running => "running",
            Self::Held => "held",
            Self::Paused => "paused",
            Self::Ending => "ending",
            Self::Finished => "finished",
            Self::Aborted => "aborted",
            Self::Rejected => "rejected",
            Self::Faulted => "faulted",
            Self::Interrupted => "interrupted",
            Self::Later(word) => word,
        })
    }
}

/// What happens to a program when its client's link goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum OnDisconnect {
    /// Stop along the path and abort it.
    #[default]
    Stop,
    /// Run what was accepted to its end.
    Finish,
}

/// A certain remedy: characters `column` to `end_column` of the line become `text`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Edit {
    /// First character, from 1.
    pub column: u64,
    /// Behind the last character.
    pub end_column: u64,
    /// What replaces them.
    pub text: String,
}

/// One fault of a program, placed in its text; columns are code points from 1, the end exclusive.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Diagnostic {
    /// Stable code, such as MC104.
    pub code: String,
    /// One sentence.
    pub message: String,
    /// Line number; 0: none.
    #[serde(default)]
    pub line: u64,
    /// First character, from 1; 0: none.
    #[serde(default)]
    pub column: u64,
    /// Behind the last character.
    #[serde(default)]
    pub end_column: u64,
    /// The remedy.
    #[serde(default)]
    pub hint: String,
    /// `error`, `warning`.
    #[serde(default = "error_severity")]
    pub severity: String,
    /// The tool concerned.
    #[serde(default)]
    pub tool: Option<u64>,
    /// What is left of a path that inverse kinematics does not reach [mm].
    #[serde(default)]
    pub residual_mm: Option<f64>,
    /// The axis concerned.
    #[serde(default)]
    pub axis: Option<u64>,
    /// Set where one remedy is certain.
    #[serde(default)]
    pub edit: Option<Edit>,
}

/// What stopped motion; `axis` and `line` where they apply.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Fault {
    /// Stable code, such as MC401.
    pub code: String,
    /// One sentence.
    pub message: String,
    /// The remedy.
    #[serde(default)]
    pub hint: String,
    /// The axis concerned.
    #[serde(default)]
    pub axis: Option<u64>,
    /// Line under way; 0: none.
    #[serde(default)]
    pub line: u64,
    /// The program concerned.
    #[serde(default)]
    pub program: Option<String>,
    /// Executor time [s].
    #[serde(default)]
    pub t: f64,
}

/// Cumulative acknowledgement of a program's lines: the last one counts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Ack {
    /// The program's id.
    pub program: String,
    /// Lines through this number are taken and journaled.
    pub accepted: u64,
    /// Lines through this number have ended.
    pub done: u64,
    /// How many lines after `accepted` fit now.
    pub credit: u64,
    /// The program's state.
    pub state: ProgramState,
    /// The faulty line; 0: none.
    #[serde(default)]
    pub rejected: u64,
    /// What is wrong with it.
    #[serde(default)]
    pub diagnostics: Vec<Diagnostic>,
    /// What stopped the program.
    #[serde(default)]
    pub fault: Option<Fault>,
    /// The number expected, in answer to a gap; 0: no gap.
    #[serde(default)]
    pub expected: u64,
    /// Rejections of lines so far; an acknowledgement with a smaller count than one before is older.
    #[serde(default)]
    pub rejections: u64,
}

/// One program as the server knows it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ProgramStatus {
    /// Its id.
    pub program: String,
    /// Its state.
    pub state: ProgramState,
    /// The client that opened it.
    #[serde(default)]
    pub client: String,
    /// For people.
    #[serde(default)]
    pub name: String,
    /// Axes it leases.
    #[serde(default)]
    pub axes: Vec<u64>,
    /// The first line that runs.
    #[serde(default = "one")]
    pub start_line: u64,
    /// Line under way; 0: none yet.
    #[serde(default)]
    pub line: u64,
    /// Lines through this number are taken and journaled.
    #[serde(default)]
    pub accepted: u64,
    /// Lines through this number have ended.
    #[serde(default)]
    pub done: u64,
    /// How many lines after `accepted` fit now.
    #[serde(default)]
    pub credit: u64,
    /// No more lines come.
    #[serde(default)]
    pub closed: bool,
    /// Feed override [%].
    #[serde(default = "hundred", rename = "override")]
    pub override_percent: f64,
    /// Share of its time that has passed, 0 … 1; without `duration_s` of its accepted lines.
    #[serde(default)]
    pub progress: f64,
    /// Time to its end at its override [s]; without `duration_s` to the end of what is planned.
    #[serde(default)]
    pub eta_s: Option<f64>,
    /// What stopped it.
    #[serde(default)]
    pub fault: Option<Fault>,
    /// The faulty line; 0: none.
    #[serde(default)]
    pub rejected: u64,
    /// What is wrong with it.
    #[serde(default)]
    pub diagnostics: Vec<Diagnostic>,
    /// The interrupted program that it goes on with.
    #[serde(default)]
    pub resume_of: Option<String>,
    /// Unix time [s].
    #[serde(default)]
    pub opened_at: f64,
    /// Unix time [s].
    #[serde(default)]
    pub ended_at: Option<f64>,
    /// Of the whole program at 100 %, as its text was simulated [s].
    #[serde(default)]
    pub duration_s: Option<f64>,
    /// What it said last to the operator; while it is paused, what to do.
    #[serde(default)]
    pub notice: String,
    /// As of [`Ack`]; 0 in programs of an earlier start of the server.
    #[serde(default)]
    pub rejections: u64,
}

/// Reply of `open`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OpenReply {
    /// The program's id.
    pub program: String,
    /// Its state.
    pub state: ProgramState,
    /// Axes that it leases.
    pub axes: Vec<u64>,
    /// The next line number.
    pub expected: u64,
    /// How many lines fit now.
    pub credit: u64,
    /// The server's instance.
    pub instance: String,
}

/// Reply of `submit`, cumulative as [`Ack`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SubmitReply {
    /// The program's id.
    pub program: String,
    /// Lines through this number are taken.
    pub accepted: u64,
    /// Lines through this number have ended.
    pub done: u64,
    /// How many lines after `accepted` fit now.
    pub credit: u64,
    /// Rejections of lines so far.
    #[serde(default)]
    pub rejections: u64,
}

/// Reply of `close`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CloseReply {
    /// The program's id.
    pub program: String,
    /// The last line that will run.
    pub accepted: u64,
    /// Lines through this number have ended.
    pub done: u64,
    /// Its state.
    pub state: ProgramState,
}

/// Reply of what only does something: the programs concerned.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Done {
    /// Always so; a refusal is an error.
    #[serde(default = "yes")]
    pub ok: bool,
    /// The programs concerned.
    #[serde(default)]
    pub programs: Vec<String>,
}

/// Reply of `override`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OverrideReply {
    /// Now in force [%].
    pub percent: f64,
    /// The programs concerned.
    #[serde(default)]
    pub programs: Vec<String>,
}

/// Reply of `jog`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JogReply {
    /// The jog's program id.
    pub program: String,
}

/// Reply of `programs`, the newest first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ProgramsReply {
    /// The programs.
    pub programs: Vec<ProgramStatus>,
}

/// Payload of an error reply.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ErrorReply {
    /// Stable code.
    pub code: String,
    /// One sentence.
    pub message: String,
    /// The remedy.
    #[serde(default)]
    pub hint: String,
    /// Values that the code promises.
    #[serde(default)]
    pub details: BTreeMap<String, Value>,
    /// Faults of G-code.
    #[serde(default)]
    pub diagnostics: Vec<Diagnostic>,
}
