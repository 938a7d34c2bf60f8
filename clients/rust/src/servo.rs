//! Servo mode: axes follow targets that are streamed, within their limits.

use std::sync::Mutex;
use std::time::{Duration, Instant};

use serde::Serialize;

use crate::core::Core;
use crate::error::{Error, Result};
use crate::messages::{OpenReply, ProgramState, ProgramStatus, ServoReply, ServoRequest};
use crate::presence::lock;
use crate::program::Program;
use crate::window::Bounds;
use crate::wire::encode;

const COUNTS: Duration = Duration::from_millis(100);

/// Where axes, or a tool, are to be: positions [mm, deg], velocities [per s] or both; a row for each point, in it a number
/// for each axis.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Targets {
    /// The axes come to rest there, unless the next ones lead on.
    pub positions: Option<Vec<Vec<f64>>>,
    /// With positions, the axes pass there at them; alone, they go on at them.
    pub velocities: Option<Vec<Vec<f64>>>,
    /// When the points are, from now, ascending; none: one point, for now.
    pub times: Option<Vec<Duration>>,
    /// As of [`crate::Machine::servo`]; none: as there.
    pub counts: Option<Duration>,
    /// A tool's number: the rows are its poses X Y Z A B C and twists (X Y Z of one without orientation).
    pub tool: Option<u64>,
    /// A tool's velocities are along and about its own axes, else the base's; poses are in the base's.
    pub in_tool_frame: bool,
}

impl Targets {
    /// One point to come to rest at.
    #[must_use]
    pub fn at(positions: impl Into<Vec<f64>>) -> Self {
        Self {
            positions: Some(vec![positions.into()]),
            ..Self::default()
        }
    }

    /// Velocities to go on at, or to pass a point at.
    #[must_use]
    pub fn going(mut self, velocities: impl Into<Vec<f64>>) -> Self {
        self.velocities = Some(vec![velocities.into()]);
        self
    }

    /// The same, as poses and twists of a tool.
    #[must_use]
    pub fn of_tool(mut self, number: u64) -> Self {
        self.tool = Some(number);
        self
    }

    /// Points at these times from now.
    #[must_use]
    pub fn chunk(times: impl Into<Vec<Duration>>, positions: impl Into<Vec<Vec<f64>>>) -> Self {
        Self {
            positions: Some(positions.into()),
            times: Some(times.into()),
            ..Self::default()
        }
    }

    /// The message `StreamTargets`, an array.
    pub(crate) fn message(&self, seq: u64, sent: f64, counts: Duration) -> impl Serialize + use<'_> {
        let times: Option<Vec<f64>> =
            self.times.as_ref().map(|times| times.iter().map(Duration::as_secs_f64).collect());
        let counts = self.counts.unwrap_or(counts).as_secs_f64();
        let frame = if self.in_tool_frame { "tool" } else { "base" };
        (
            seq,
            sent,
            counts,
            &self.positions,
            &self.velocities,
            times,
            self.tool,
            frame,
        )
    }
}

/// Axes that follow what is sent.
///
/// It is ended by [`Servo::close`]. Dropped without it, such as by `?`, the axes stop at once.
pub struct Servo {
    program: Program,
    counts: Duration,
    begun: Instant,
    seq: Mutex<u64>,
}

/// What is known of a program that gets no lines.
pub(crate) fn servo_core(opened: &ServoReply) -> Core {
    let reply = OpenReply {
        program: opened.program.clone(),
        state: ProgramState::Running,
        axes: opened.axes.clone(),
        expected: 1,
        credit: 0,
        instance: String::new(),
    };
    Core::new(&reply, Bounds::default())
}

impl Servo {
    pub(crate) fn new(program: Program, counts: Duration) -> Self {
        Self {
            program,
            counts,
            begun: Instant::now(),
            seq: Mutex::new(0),
        }
    }

    /// Of the program that follows.
    #[must_use]
    pub fn id(&self) -> &str {
        self.program.id()
    }

    /// The axes that follow; rows of targets have a number for each, in this order.
    #[must_use]
    pub fn axes(&self) -> &[u64] {
        self.program.axes()
    }

    /// As last reported.
    #[must_use]
    pub fn state(&self) -> ProgramState {
        self.program.state()
    }

    /// What [`Servo::send`] and [`Servo::close`] will return, as soon as it is known.
    #[must_use]
    pub fn failure(&self) -> Option<Error> {
        self.program.failure()
    }

    /// Sends targets, which replace those before, and waits for nothing: what a full link loses is not sent again, for
    /// the next ones are newer.
    ///
    /// # Errors
    /// [`Error::ProgramAborted`] nothing came in time, or somebody stopped it; [`Error::ProgramFaulted`];
    /// [`Error::ProgramClosed`]; [`Error::NobodyAnswers`] the server has not answered for as long as targets count, and
    /// 0.5 s (MC530).
    pub fn send(&self, targets: &Targets) -> Result<()> {
        let mut seq = lock(&self.seq);
        let sent = self.begun.elapsed().as_secs_f64();
        let counts = targets.counts.unwrap_or(self.counts).as_secs_f64();
        self.program.check_targets(sent, counts)?;
        *seq += 1;
        self.program.put_newest(encode(&targets.message(*seq, sent, self.counts))?);
        Ok(())
    }

    /// Asks for the program as the server knows it; its `servo` counts what was late, lost or dropped.
    ///
    /// # Errors
    /// MC503 it knows no such program.
    pub async fn status(&self) -> Result<ProgramStatus> {
        self.program.status().await
    }

    /// Lets the axes go on to the last targets, and returns once they stand there.
    ///
    /// # Errors
    /// As [`Servo::send`].
    pub async fn close(self) -> Result<()> {
        self.program.finish().await.map(|_| ())
    }

    /// Stops the axes within their limits now.
    ///
    /// # Errors
    /// As [`crate::Program::hold`].
    pub async fn abort(&self) -> Result<()> {
        self.program.abort().await
    }
}

impl crate::Machine {
    /// Leases axes for targets that are streamed, energizes them and lets them follow; the default request is for all.
    ///
    /// `counts` is how long each message counts, up to 10 s: without a newer one by then the axes stop, and the program
    /// ends; none: 0.1 s.
    ///
    /// # Errors
    /// As [`crate::Machine::refresh_info`]; MC512 an axis is leased.
    pub async fn servo(&self, request: &ServoRequest, counts: Option<Duration>) -> Result<Servo> {
        let opened = self.open_servo(request).await?;
        let program = self.follow(servo_core(&opened), opened.axes).await?;
        Ok(Servo::new(program, counts.unwrap_or(COUNTS)))
    }
}
