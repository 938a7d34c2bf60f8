//! How a program is opened, and how it ended.

use std::time::Duration;

use crate::messages::{OnDisconnect, OpenRequest, Outputs};

const NAME_LENGTH: usize = 200;

/// How a program is opened; the default: all axes, from line 1, stopped when this client's link goes.
#[derive(Debug, Clone, Default)]
pub struct ProgramOptions(pub(crate) OpenRequest);

impl ProgramOptions {
    /// Begins with all axes, from line 1.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Names it for people: a file's name.
    #[must_use]
    pub fn name(mut self, name: impl AsRef<str>) -> Self {
        self.0.name = name.as_ref().chars().take(NAME_LENGTH).collect();
        self
    }

    /// Leases these axes only. It waits in order for axes that other programs have.
    #[must_use]
    pub fn axes(mut self, axes: impl IntoIterator<Item = u64>) -> Self {
        self.0.axes = Some(axes.into_iter().collect());
        self
    }

    /// Says what happens to what was accepted when this client's link goes.
    #[must_use]
    pub fn on_disconnect(mut self, what: OnDisconnect) -> Self {
        self.0.on_disconnect = what;
        self
    }

    /// Says how long this client's link may be away before that; 10 s otherwise.
    #[must_use]
    pub fn grace(mut self, time: Duration) -> Self {
        self.0.grace_s = time.as_secs_f64();
        self
    }

    /// Begins at this line. The lines before it do not run: the axes go to where they end, energized, in the modal state
    /// of there.
    #[must_use]
    pub fn start_line(mut self, number: u64, before: impl IntoIterator<Item = String>) -> Self {
        self.0.start_line = number;
        self.0.before = before.into_iter().collect();
        self
    }

    /// Starts a line only when [`crate::Program::step`] asks for it.
    #[must_use]
    pub fn step(mut self) -> Self {
        self.0.step = true;
        self
    }

    /// Skips lines that begin with `/`.
    #[must_use]
    pub fn block_delete(mut self) -> Self {
        self.0.block_delete = Some(true);
        self
    }

    /// Says whether M01 pauses; it does otherwise.
    #[must_use]
    pub fn optional_stop(mut self, pauses: bool) -> Self {
        self.0.optional_stop = Some(pauses);
        self
    }

    /// Begins held.
    #[must_use]
    pub fn hold(mut self) -> Self {
        self.0.hold = true;
        self
    }

    /// Of a start in the middle: axes may go the way that `continuation` shows, where the machine
    /// file names no safe one.
    #[must_use]
    pub fn way(mut self) -> Self {
        self.0.way = true;
        self
    }

    /// Of a start in the middle: `set` what the program had switched, or `leave` it.
    #[must_use]
    pub fn outputs(mut self, what: Outputs) -> Self {
        self.0.outputs = Some(what);
        self
    }
}

/// How a program ended well; whatever else can happen is an error.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct ProgramResult {
    /// Its id.
    pub program: String,
    /// Lines through this number were taken.
    pub accepted: u64,
    /// Lines through this number have ended.
    pub done: u64,
}
