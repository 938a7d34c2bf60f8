//! Drives on CAN buses.

use serde::{Deserialize, Serialize};

use super::binary::Bytes;

/// A value of a drive's dictionary.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum SdoValue {
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

/// What the machine file shows of a drive; no value: none has come lately.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MonitoredValue {
    /// For people.
    pub name: String,
    /// The value.
    #[serde(default)]
    pub value: Option<SdoValue>,
    /// Of an object.
    #[serde(default)]
    pub index: u64,
    /// Of an object.
    #[serde(default)]
    pub subindex: u64,
}

/// One drive on a CAN bus; ages are in seconds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DriveInfo {
    /// Its axis.
    pub axis: u64,
    /// Kind of drive.
    pub kind: String,
    /// The bus's name.
    pub bus: String,
    /// Node, 1 … 127.
    pub node: u64,
    /// `booting operational lost restarting failed closed`.
    pub state: String,
    /// What its last heartbeat said.
    #[serde(default)]
    pub nmt: String,
    /// Age of the last heartbeat [s].
    #[serde(default)]
    pub heartbeat_age_s: Option<f64>,
    /// 6041h.
    #[serde(default)]
    pub statusword: Option<u64>,
    /// The statusword in words.
    #[serde(default)]
    pub status: String,
    /// 1000h.
    #[serde(default)]
    pub device_type: Option<u64>,
    /// 1018h:1.
    #[serde(default)]
    pub vendor_id: Option<u64>,
    /// 1018h:2.
    #[serde(default)]
    pub product_code: Option<u64>,
    /// The last emergency message in words.
    #[serde(default)]
    pub emergency: String,
    /// Its code.
    #[serde(default)]
    pub emergency_code: Option<u64>,
    /// Its age [s].
    #[serde(default)]
    pub emergency_age_s: Option<f64>,
    /// How often it has started.
    #[serde(default)]
    pub boot_ups: u64,
    /// Why its configuration failed.
    #[serde(default)]
    pub message: String,
    /// Objects that the machine file shows.
    #[serde(default)]
    pub monitor: Vec<MonitoredValue>,
}

/// Reply of `drives`, by axis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DrivesReply {
    /// The drives; empty where none is on a CAN bus.
    pub drives: Vec<DriveInfo>,
}

/// Reply of `sdo_read` and `sdo_write`: an object of a drive's dictionary.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SdoReply {
    /// The drive's axis.
    pub axis: u64,
    /// The bus's name.
    pub bus: String,
    /// Node, 1 … 127.
    pub node: u64,
    /// The object.
    pub index: u64,
    /// The object.
    pub subindex: u64,
    /// Such as `u16`.
    #[serde(rename = "type")]
    pub kind: String,
    /// The value; of `bytes` hexadecimal text.
    pub value: SdoValue,
    /// Its bytes, little endian.
    pub raw: Bytes,
}
