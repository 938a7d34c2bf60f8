//! Runs that an operator arms (docs/wire/arming.md).

use serde::{Deserialize, Serialize};

use super::hundred;
use super::program::Diagnostic;

/// What an axis moves through in a run that was asked for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Extent {
    /// The axis.
    pub axis: u64,
    /// [mm, deg]
    pub low: f64,
    /// [mm, deg]
    pub high: f64,
    /// `mm` or `deg`.
    pub unit: String,
}

/// A run that waits for an operator, is armed, or was started (docs/wire/arming.md).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunRequestStatus {
    /// Of the text.
    pub sha256: String,
    /// Who asked.
    pub client: String,
    /// For people.
    pub name: String,
    /// `waiting`, `armed`, `started`.
    pub state: String,
    /// Its axes.
    pub axes: Vec<u64>,
    /// [s]
    pub duration_s: f64,
    /// What each axis moves through.
    pub extents: Vec<Extent>,
    /// How long it may still be started [s].
    #[serde(default)]
    pub remaining_s: f64,
    /// The greatest feed override [%].
    #[serde(default = "hundred", rename = "override")]
    pub override_percent: f64,
    /// Who armed it.
    #[serde(default)]
    pub operator: String,
    /// Another one each time that the run is asked for, even with the same text.
    #[serde(default)]
    pub number: u64,
}

/// Where a tool is at the moments of a [`RunPath`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ToolPath {
    /// Its number.
    pub tool: u64,
    /// X, Y and Z, a value a moment [mm].
    pub position: Vec<Vec<f64>>,
}

/// The simulated path of a request, for a picture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunPath {
    /// Moments [s].
    pub time_s: Vec<f64>,
    /// For each axis of the request a setpoint a moment [mm, deg].
    pub positions: Vec<Vec<f64>>,
    /// The tools that these axes move.
    pub tools: Vec<ToolPath>,
}

/// Reply of `run_preview`: what an operator looks at before arming.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunPreviewReply {
    /// The request.
    pub run: RunRequestStatus,
    /// Its text.
    pub text: String,
    /// As simulated.
    pub path: RunPath,
}

/// Reply of `request_run`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunRequestReply {
    /// No fault was found.
    pub ok: bool,
    /// What was found.
    #[serde(default)]
    pub diagnostics: Vec<Diagnostic>,
    /// None for a text with faults.
    #[serde(default)]
    pub run: Option<RunRequestStatus>,
}

/// Reply of `run_requests`, the oldest first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunRequestsReply {
    /// What waits.
    pub requests: Vec<RunRequestStatus>,
}

/// Reply of `run_armed`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunArmedReply {
    /// The program's id.
    pub program: String,
    /// In force at most [%].
    #[serde(rename = "override")]
    pub override_percent: f64,
}
