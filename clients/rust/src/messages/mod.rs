//! The messages of the key space, as plain values (docs/keyspace.md).
//!
//! Positions are in mm (linear axes) or deg (rotary axes), velocities in mm/s or deg/s, torques in N·m, times in
//! seconds since the executor's start, percentages in %. Keys that this version does not know are skipped, fields
//! that are left out have their default.

mod arming;
mod binary;
mod channels;
mod drives;
mod machine;
mod program;

pub use arming::{
    Extent, RunArmedReply, RunPath, RunPreviewReply, RunRequestReply, RunRequestStatus, RunRequestsReply,
    ToolPath,
};
pub use binary::{Bytes, TelemetryBlock};
pub use channels::{InputInfo, InputStatus, OutputInfo, OutputStatus};
pub use drives::{DriveInfo, DrivesReply, MonitoredValue, SdoReply, SdoValue};
pub use machine::{
    AxesStatus, AxisInfo, CheckResult, DiskStatus, Event, EventPage, Info, LimitsInfo, LineReport, MachineStatus,
    ProbeStatus, TelemetryInfo, ToolInfo, ToolPose, WorkOffset,
};
pub use program::{
    Ack, CloseReply, Diagnostic, Done, Edit, ErrorReply, Fault, JogReply, OnDisconnect, OpenReply,
    OverrideReply, ProgramState, ProgramStatus, ProgramsReply, SubmitReply,
};

/// A feed override that nobody has changed [%].
fn hundred() -> f64 {
    100.0
}
