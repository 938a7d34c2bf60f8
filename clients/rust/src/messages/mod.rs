//! The messages of the key space, as plain values (docs/keyspace.md).
//!
//! Positions are in mm (linear axes) or deg (rotary axes), velocities in mm/s or deg/s, torques in N·m, times in
//! seconds since the executor's start, percentages in %. Keys that this version does not know are skipped, fields
//! that are left out have their default. Of a request, `new` takes what has to be there:
//! `JogRequest { distance: Some(5.0), ..JogRequest::new(0) }`.

mod binary;
#[rustfmt::skip]
// requests are those of the wire, whose switches stand beside each other
#[allow(missing_docs, clippy::struct_excessive_bools)]
mod made;
mod words;

pub use binary::{Bytes, TelemetryBlock};
pub use made::*;

impl ProgramState {
    /// Whether the program has ended, well or not.
    #[must_use]
    pub fn is_end(&self) -> bool {
        use ProgramState::{Aborted, Faulted, Finished, Interrupted, Rejected};
        matches!(self, Finished | Aborted | Rejected | Faulted | Interrupted)
    }
}
