//! Client of the open motion server: programs, telemetry and operation of machines, over Zenoh.
//!
//! ```no_run
//! use mcclient::{Machine, OpenRequest};
//!
//! #[tokio::main]
//! async fn main() -> mcclient::Result<()> {
//!     let machine = Machine::connect().await?;
//!     let program = machine.program(OpenRequest::default()).await?;
//!     program.send("G1010").await?; // energize
//!     program.send("G01 X10 F600").await?;
//!     println!("done through line {}", program.finish().await?.done);
//!     machine.close().await;
//!     Ok(())
//! }
//! ```
//!
//! A *program* is a stream of lines with modal state of its own. Every line runs exactly once, also over a link that
//! breaks; a fault comes with line and column. Only the server is believed: replies, acknowledgements, events and
//! telemetry that come from any other session on the network are dropped.

#![forbid(unsafe_code)]

mod calls;
mod connection;
mod core;
mod discovery;
mod error;
mod estop;
mod events;
mod feed;
mod jog;
mod keys;
mod link;
mod machine;
#[rustfmt::skip]
mod machine_calls;
pub mod messages;
mod presence;
mod program;
mod servo;
mod stream;
mod telemetry;
mod window;
mod wire;

#[cfg(test)]
mod contract_tests;
#[cfg(test)]
#[rustfmt::skip]
mod contract_readers;
#[cfg(test)]
mod core_tests;

pub use discovery::{ConnectOptions, list_machines};
pub use error::{Error, Problem, ProgramProblem, Result};
pub use estop::{EmergencyStop, emergency_stop};
pub use feed::Feed;
pub use jog::HeldJog;
pub use machine::Machine;
pub use messages::{
    CheckReply, Continuation, ContinueRequest, Diagnostic, Event, Fault, Info, LineReport, MachineStatus,
    OnDisconnect, OpenRequest, ProgramState, ProgramStatus, ServoRequest,
};
pub use program::{Program, ProgramResult};
pub use servo::{Servo, Targets};
pub use telemetry::Samples;

/// The page docs/rust.md: its examples run against a server when the tests of the repository ask for it.
#[cfg(all(doctest, guide))]
#[doc = include_str!("../../../docs/rust.md")]
mod guide {}
