//! Inputs and outputs.

use serde::{Deserialize, Serialize};

fn one() -> f64 {
    1.0
}

/// An input: its value (digital: 0, 1), and whether it holds the programs or stops the machine now.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct InputStatus {
    /// Its name.
    pub name: String,
    /// Its value, in its unit.
    pub value: f64,
    /// It holds the programs.
    #[serde(default)]
    pub holds: bool,
    /// It stops the machine.
    #[serde(default)]
    pub stops: bool,
}

/// An output: its value (digital: 0, 1), and who has set it last.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OutputStatus {
    /// Its name.
    pub name: String,
    /// Its value, in its unit.
    pub value: f64,
    /// A program's id, `operator` or nobody (empty).
    #[serde(default)]
    pub set_by: String,
}

/// One input of the machine.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct InputInfo {
    /// Its name.
    pub name: String,
    /// Of its kind, as M66 names it.
    pub number: u64,
    /// `digital` or `analog`.
    pub kind: String,
    /// Of its value.
    #[serde(default)]
    pub unit: String,
    /// Where a real one comes from; empty: it is simulated.
    #[serde(default)]
    pub source: String,
    /// It can hold the programs.
    #[serde(default)]
    pub hold: bool,
    /// It can stop the machine.
    #[serde(default)]
    pub stop: bool,
}

/// One output of the machine.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OutputInfo {
    /// Its name.
    pub name: String,
    /// Of its kind, as M62 to M68 name it.
    pub number: u64,
    /// `digital` or `analog`.
    pub kind: String,
    /// Of its value.
    #[serde(default)]
    pub unit: String,
    /// Where a real one goes; empty: it is simulated.
    #[serde(default)]
    pub target: String,
    /// The least value.
    #[serde(default)]
    pub min: f64,
    /// The greatest value.
    #[serde(default = "one")]
    pub max: f64,
    /// Its value once what has set it is lost; none: it stays.
    #[serde(default)]
    pub safe: Option<f64>,
}
