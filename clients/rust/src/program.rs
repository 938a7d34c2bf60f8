//! A program: lines streamed within the server's credit, repeated after a loss, never lost and never run twice.

use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use futures_core::Stream;
use tokio::runtime::Handle;
use tokio::sync::Mutex;

use crate::calls::{Caller, Trying};
use crate::connection::Connection;
use crate::core::Core;
use crate::error::{Error, Problem, Result};
use crate::feed::Feed;
use crate::messages::{CloseReply, CloseRequest, Event, ProgramRequest, ProgramState, ProgramStatus};
use crate::stream::{Giving, LineStream};
use crate::wire::decode;

const ABORT_DEADLINE: Duration = Duration::from_secs(2);
/// Gives the runtime to others while a long file is read.
const LINES_A_TURN: usize = 500;

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

/// One client's stream of lines, with modal state and axes of its own.
///
/// It is ended by [`Program::finish`]. Dropped without it, such as by `?`, it is aborted; [`Program::leave`] lets it run
/// on as `on_disconnect` says.
pub struct Program {
    stream: LineStream,
    caller: Caller,
    machine: Arc<Connection>,
    axes: Vec<u64>,
    max_line_length: u64,
    turn: Mutex<()>,
    left: AtomicBool,
}

impl Program {
    pub(crate) fn new(stream: LineStream, machine: Arc<Connection>, axes: Vec<u64>) -> Self {
        Self {
            stream,
            caller: machine.caller.clone(),
            max_line_length: machine.info().limits.max_line_length,
            machine,
            axes,
            turn: Mutex::new(()),
            left: AtomicBool::new(false),
        }
    }

    fn core<T>(&self, look: impl FnOnce(&Core) -> T) -> T {
        self.stream.shared.with(|core, _| look(core))
    }

    /// Its id.
    #[must_use]
    pub fn id(&self) -> &str {
        &self.stream.shared.program
    }

    /// The axes that it leases.
    #[must_use]
    pub fn axes(&self) -> &[u64] {
        &self.axes
    }

    /// As last reported.
    #[must_use]
    pub fn state(&self) -> ProgramState {
        self.core(Core::state)
    }

    /// Number of the last line given.
    #[must_use]
    pub fn given_through(&self) -> u64 {
        self.core(Core::given)
    }

    /// Lines through this number are taken and journaled by the server.
    #[must_use]
    pub fn accepted_through(&self) -> u64 {
        self.core(Core::accepted)
    }

    /// Lines through this number have ended.
    #[must_use]
    pub fn done_through(&self) -> u64 {
        self.core(Core::done)
    }

    /// Lines given that have not ended yet: how far this client is ahead of the motion.
    #[must_use]
    pub fn lines_ahead(&self) -> u64 {
        self.core(|core| core.given().saturating_sub(core.done()))
    }

    /// How many lines beyond those accepted the server takes now.
    #[must_use]
    pub fn credit(&self) -> u64 {
        self.core(Core::credit)
    }

    /// What [`Program::done`] and [`Program::finish`] will return, as soon as it is known.
    #[must_use]
    pub fn failure(&self) -> Option<Error> {
        self.core(|core| core.failure().cloned())
    }

    /// Refuses what comes once the program has ended or is closed.
    pub(crate) fn check_targets(&self, now: f64, counts: f64) -> Result<()> {
        self.stream.shared.with(|core, _| core.check_targets(now, counts))
    }

    /// Puts a message of which the next one is newer.
    pub(crate) fn put_newest(&self, payload: Vec<u8>) {
        self.machine.link.put_newest(&self.machine.keys.lines_in(self.id()), payload);
    }

    // ------------------------------------------------------------ lines

    /// Sends one line and waits for the verdict on it; it may still be waiting to move. Returns its number.
    ///
    /// A call that is dropped may have sent the line all the same.
    ///
    /// # Errors
    /// [`Error::ProgramRejected`] the line has faults, nothing of it moves, and the program goes on living; another
    /// error of the program where it has ended; [`Error::NobodyAnswers`].
    pub async fn send(&self, line: &str) -> Result<u64> {
        let text = self.checked(line)?;
        let _turn = self.turn.lock().await;
        let stream = &self.stream.shared;
        stream.with(|core, _| core.begin())?;
        stream.accepted_all().await?;
        stream.with(|core, _| core.check_open())?;
        stream.submit(text).await
    }

    /// Streams lines as fast as the server takes them, with bounded memory; returns the last one's number.
    ///
    /// It returns once all are accepted. A fault of a line that is judged later comes from [`Program::done`] and
    /// [`Program::finish`]. Where the future is dropped before, lines that have not been sent are given up; those under
    /// way may be accepted, and the next line has the number behind them ([`Program::given_through`]).
    ///
    /// # Errors
    /// As [`Program::send`]; the lines before a faulty one are taken.
    pub async fn send_lines<I>(&self, lines: I) -> Result<u64>
    where
        I: IntoIterator,
        I::Item: AsRef<str>,
    {
        let _turn = self.turn.lock().await;
        self.begin_lines()?;
        let giving = Giving::new(&self.stream.shared);
        for (count, line) in lines.into_iter().enumerate() {
            self.give(line.as_ref()).await?;
            if count % LINES_A_TURN == LINES_A_TURN - 1 {
                tokio::task::yield_now().await;
            }
        }
        self.end_lines(giving).await
    }

    /// As [`Program::send_lines`], of lines that arrive one by one.
    ///
    /// # Errors
    /// As [`Program::send_lines`].
    pub async fn send_stream<S>(&self, lines: S) -> Result<u64>
    where
        S: Stream,
        S::Item: AsRef<str>,
    {
        let _turn = self.turn.lock().await;
        self.begin_lines()?;
        let giving = Giving::new(&self.stream.shared);
        let mut lines = pin!(lines);
        while let Some(line) = std::future::poll_fn(|context| lines.as_mut().poll_next(context)).await {
            self.give(line.as_ref()).await?;
        }
        self.end_lines(giving).await
    }

    fn begin_lines(&self) -> Result<()> {
        self.stream.shared.with(|core, _| {
            core.begin()?;
            core.check_open()
        })
    }

    async fn give(&self, line: &str) -> Result<()> {
        let text = self.checked(line)?.to_owned();
        self.stream.shared.give(text).await.map(|_| ())
    }

    async fn end_lines(&self, giving: Giving<'_>) -> Result<u64> {
        self.stream.shared.accepted_all().await?;
        giving.completed();
        self.stream.shared.with(|core, _| core.check_giving().map(|()| core.given()))
    }

    // ------------------------------------------------------------ the end

    /// Waits until the line with this number has ended.
    ///
    /// # Errors
    /// As [`Program::done`].
    pub async fn wait_done(&self, number: u64) -> Result<()> {
        // lines after M02 or M30 are accepted and never run
        let reached = |core: &Core| core.done() >= number || core.state() == ProgramState::Finished;
        self.stream.shared.until(reached, false).await
    }

    /// Waits until every line given so far has ended.
    ///
    /// # Errors
    /// How it ended instead: [`Error::ProgramRejected`], [`Error::ProgramFaulted`], [`Error::ProgramAborted`],
    /// [`Error::ProgramInterrupted`]; [`Error::NobodyAnswers`] the server has been away for longer than the client's
    /// patience.
    pub async fn done(&self) -> Result<()> {
        self.wait_done(self.given_through()).await?;
        self.stream.shared.with(|core, _| core.check())
    }

    /// Says that no more lines will come; what is accepted runs to its end. Again is no error.
    ///
    /// # Errors
    /// As [`Program::send_lines`].
    pub async fn close(&self) -> Result<()> {
        let _turn = self.turn.lock().await;
        let stream = &self.stream.shared;
        if stream.with(|core, _| core.ended() || core.is_closed()) {
            return Ok(());
        }
        stream.accepted_all().await?;
        let request = CloseRequest {
            program: self.id().to_owned(),
            last: None,
        };
        let trying = Trying::within(self.machine.patience);
        let payload = match self.caller.call("close", &request, trying).await {
            Ok(payload) => payload,
            Err(error @ Error::RequestRefused(_)) => return Err(stream.translated(error).await),
            Err(error) => return Err(error),
        };
        let reply: CloseReply = decode(&payload)?;
        stream.with(|core, _| core.set_closed());
        if reply.state.is_end() {
            // the reply does not say why it ended
            return stream.resynchronise().await;
        }
        stream.with(|core, _| core.progress(&reply.state, reply.done, None, &[], ""));
        stream.tell();
        Ok(())
    }

    /// Closes the program and waits until it has ended.
    ///
    /// # Errors
    /// As [`Program::done`], once it has ended.
    pub async fn finish(&self) -> Result<ProgramResult> {
        let mut rejection = None;
        if let Err(error) = self.close().await {
            if !matches!(error, Error::ProgramRejected(_)) {
                return Err(error);
            }
            // returned once what is before the rejected line has run
            rejection = Some(error);
            self.close().await?;
        }
        let stream = &self.stream.shared;
        stream.until(Core::ended, true).await?;
        stream.with(|core, _| core.check())?;
        if let Some(error) = rejection {
            return Err(error);
        }
        let extent = self.core(Core::extent);
        Ok(ProgramResult {
            program: extent.program,
            accepted: extent.accepted,
            done: extent.done,
        })
    }

    /// Stops following the program without ending it; `on_disconnect` decides once the client closes. Returns its id.
    pub fn leave(self) -> String {
        self.left.store(true, Ordering::Relaxed);
        self.id().to_owned()
    }

    // ------------------------------------------------------------ the operator's part

    /// Feed hold along the path.
    ///
    /// # Errors
    /// [`Error::RequestRefused`], [`Error::NobodyAnswers`]; so the next ones.
    pub async fn hold(&self) -> Result<()> {
        self.machine.order("hold", self.id()).await
    }

    /// Ends a hold, M00 or M01.
    ///
    /// # Errors
    /// As [`Program::hold`].
    pub async fn resume(&self) -> Result<()> {
        self.machine.order("resume", self.id()).await
    }

    /// Starts the next line of a program opened with [`crate::messages::OpenRequest::step`].
    ///
    /// # Errors
    /// As [`Program::hold`].
    pub async fn step(&self) -> Result<()> {
        self.machine.order("step", self.id()).await
    }

    /// Stops along the path and drops the rest; the program ends as aborted.
    ///
    /// # Errors
    /// As [`Program::hold`].
    pub async fn abort(&self) -> Result<()> {
        self.machine.order("abort", self.id()).await
    }

    /// Sets the feed override of this program [%]; returns the one now in force.
    ///
    /// # Errors
    /// As [`Program::hold`].
    pub async fn set_override(&self, percent: f64) -> Result<f64> {
        self.machine.set_override(percent, self.id()).await
    }

    /// Asks for the program as the server knows it.
    ///
    /// # Errors
    /// MC503 it knows no such program.
    pub async fn status(&self) -> Result<ProgramStatus> {
        let status = self.stream.shared.ask_status().await?;
        status.ok_or_else(|| {
            Error::RequestRefused(Box::new(Problem::new(
                "MC503",
                format!("the server knows no program {}", self.id()),
                "Machine::programs lists them",
            )))
        })
    }

    /// Listens to this program's events from now on; the feed ends behind `program.ended`.
    ///
    /// # Errors
    /// As [`Program::hold`].
    pub async fn events(&self) -> Result<Feed<Event>> {
        self.machine.open_events(false, Some(self.id().to_owned())).await
    }

    fn checked<'a>(&self, line: &'a str) -> Result<&'a str> {
        let text = line.trim_end_matches(['\r', '\n']);
        let refuse = |message: String, hint: &str| {
            let problem = Problem::new("MC538", message, hint).at(self.given_through() + 1, Vec::new());
            Err(Error::RequestRefused(Box::new(problem)))
        };
        if text.contains(['\r', '\n']) {
            return refuse(
                "a line must not hold a line end".to_owned(),
                "use send_lines(text.lines())",
            );
        }
        let length = text.chars().count() as u64;
        if length > self.max_line_length {
            let most = self.max_line_length;
            return refuse(
                format!("the line has {length} characters, the server takes {most}"),
                "break it at a command",
            );
        }
        Ok(text)
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        let ended = self.core(Core::ended);
        if ended || self.left.load(Ordering::Relaxed) {
            return;
        }
        let Ok(runtime) = Handle::try_current() else {
            return;
        };
        let (caller, program) = (self.caller.clone(), self.id().to_owned());
        runtime.spawn(async move {
            let request = ProgramRequest {
                program: Some(program),
            };
            if let Err(error) = caller.call("abort", &request, Trying::within(ABORT_DEADLINE)).await {
                tracing::debug!("aborting a program that was dropped: {error}");
            }
        });
    }
}
