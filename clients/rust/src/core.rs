//! What is known of one program's lines and what is to be done next: a state machine without I/O and without a clock.
//!
//! The driver ([`crate::stream`]) calls it with what it hears and with the time, and carries out the [`Step`] that it
//! answers. So sequences of losses, repeats, rejections and restarts are played in tests without a network.

use std::time::Duration;

use crate::error::{Error, Extent};
use crate::messages::{Ack, Diagnostic, Fault, OpenReply, ProgramState, ProgramStatus, SubmitReply};
use crate::window::{Bounds, Chunk, LineWindow};

/// Without an acknowledgement for so long the server is asked; doubled up to the longest while it says nothing new.
pub(crate) const FIRST_DOUBT: Duration = Duration::from_millis(250);
const LONGEST_DOUBT: Duration = Duration::from_secs(2);

/// What the driver does next.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Step {
    /// Put these lines.
    Send(Chunk),
    /// Ask the server how far the program is, and give the answer to [`Core::on_status`] or [`Core::fail`].
    Ask,
    /// Wait until something happens, or until this time.
    WaitUntil(Duration),
    /// Wait until something happens.
    Wait,
}

/// Why a program does not go on.
#[derive(Debug)]
struct Failure {
    error: Error,
    /// It has been returned to the caller: a rejection then does not keep its line from being sent anew.
    reported: bool,
}

/// One program's lines on their way.
#[derive(Debug)]
pub(crate) struct Core {
    program: String,
    window: LineWindow,
    state: ProgramState,
    done: u64,
    closed: bool,
    failure: Option<Failure>,
    /// A line is under judgement by `submit`: its reply says whether it is faulty, not the acknowledgements.
    judging: bool,
    /// Lines were rejected, and puts of theirs may be on their way.
    stragglers: bool,
    /// When the server was heard last; none: what is known may be old.
    heard_at: Option<Duration>,
    doubt: Duration,
}

impl Core {
    pub fn new(opened: &OpenReply, now: Duration) -> Self {
        Self::with_bounds(opened, now, Bounds::default())
    }

    pub fn with_bounds(opened: &OpenReply, now: Duration, bounds: Bounds) -> Self {
        Self {
            program: opened.program.clone(),
            window: LineWindow::new(opened.expected, opened.credit, bounds),
            state: opened.state.clone(),
            done: opened.expected.saturating_sub(1),
            closed: false,
            failure: None,
            judging: false,
            stragglers: false,
            heard_at: Some(now),
            doubt: FIRST_DOUBT,
        }
    }

    // ------------------------------------------------------------ what is known

    pub fn state(&self) -> ProgramState {
        self.state.clone()
    }

    pub fn done(&self) -> u64 {
        self.done
    }

    pub fn accepted(&self) -> u64 {
        self.window.accepted()
    }

    pub fn given(&self) -> u64 {
        self.window.given()
    }

    pub fn credit(&self) -> u64 {
        self.window.credit()
    }

    pub fn pending(&self) -> bool {
        self.window.pending()
    }

    pub fn has_room(&self) -> bool {
        self.window.has_room()
    }

    pub fn ended(&self) -> bool {
        self.state.is_end()
    }

    pub fn has_stragglers(&self) -> bool {
        self.stragglers
    }

    pub fn extent(&self) -> Extent {
        Extent {
            program: self.program.clone(),
            accepted: self.window.accepted(),
            done: self.done,
        }
    }

    pub fn failure(&self) -> Option<&Error> {
        self.failure.as_ref().map(|failure| &failure.error)
    }

    fn rejected(&self) -> bool {
        matches!(self.failure(), Some(Error::ProgramRejected(_)))
    }

    /// Returns the failure where there is one; a rejection that was reported does not keep its line from being sent
    /// anew.
    pub fn check(&mut self) -> Result<(), Error> {
        let ended_by_it = self.state == ProgramState::Rejected;
        let Some(failure) = &mut self.failure else {
            return Ok(());
        };
        if failure.reported && matches!(failure.error, Error::ProgramRejected(_)) && !ended_by_it {
            return Ok(());
        }
        failure.reported = true;
        Err(failure.error.clone())
    }

    /// Returns why a wait cannot end any more.
    ///
    /// `past_rejection`: what is before a rejected line is waited for all the same.
    pub fn check_wait(&mut self, past_rejection: bool) -> Result<(), Error> {
        if !(past_rejection && self.rejected()) {
            self.check()?;
        }
        if self.ended() && self.window.pending() {
            return Err(self.extent().closed(&self.state.to_string()));
        }
        Ok(())
    }

    /// Returns an error where the program takes no more lines.
    pub fn check_open(&mut self) -> Result<(), Error> {
        self.check()?;
        if self.ended() {
            return Err(self.extent().closed(&self.state.to_string()));
        }
        if self.closed {
            return Err(self.extent().closed("closed"));
        }
        Ok(())
    }

    // ------------------------------------------------------------ what the caller does

    /// Appends a line and returns its number.
    pub fn give(&mut self, line: String) -> u64 {
        self.window.give(line)
    }

    /// While a line is under judgement by a call, nothing is put beside it.
    pub fn judge(&mut self, judging: bool) {
        self.judging = judging;
    }

    pub fn set_closed(&mut self) {
        self.closed = true;
    }

    pub fn is_closed(&self) -> bool {
        self.closed
    }

    // ------------------------------------------------------------ what the server says

    pub fn on_ack(&mut self, ack: &Ack, now: Duration) {
        self.take(ack.accepted, ack.credit, ack.expected, now);
        self.hear_rejection(&ack.state, ack.rejected, ack.accepted, &ack.diagnostics);
        self.progress(&ack.state, ack.done, ack.fault.as_ref(), &ack.diagnostics);
    }

    /// Takes the answer to [`Step::Ask`]; none: the server knows no such program.
    pub fn on_status(&mut self, status: Option<&ProgramStatus>, now: Duration) {
        let Some(status) = status else {
            self.progress(&ProgramState::Interrupted, 0, None, &[]);
            return;
        };
        self.take(status.accepted, status.credit, 0, now);
        if !self.judging {
            self.window.rewind();
        }
        self.hear_rejection(
            &status.state,
            status.rejected,
            status.accepted,
            &status.diagnostics,
        );
        self.progress(
            &status.state,
            status.done,
            status.fault.as_ref(),
            &status.diagnostics,
        );
    }

    /// The server is there again, perhaps another start of it: what is known may be old.
    pub fn on_server_return(&mut self) {
        if matches!(
            self.failure(),
            Some(Error::NobodyAnswers(_) | Error::NoAnswerInTime(_))
        ) {
            self.failure = None;
        }
        self.heard_at = None;
    }

    /// Takes the numbers of a reply or of a refusal's details.
    pub fn take(&mut self, accepted: u64, credit: u64, expected: u64, now: Duration) {
        self.heard_at = Some(now);
        self.window.acknowledge(accepted, credit, expected);
    }

    /// Takes the program's state; the first one that is an end stays.
    pub fn progress(
        &mut self,
        state: &ProgramState,
        done: u64,
        fault: Option<&Fault>,
        diagnostics: &[Diagnostic],
    ) {
        self.done = self.done.max(done);
        if self.ended() {
            return;
        }
        self.state = state.clone();
        if self.ended() && (self.failure.is_none() || *state != ProgramState::Finished) {
            let ending = self.extent().ending(state, fault, diagnostics);
            self.fail(ending);
        }
    }

    /// Takes the reply to a line under judgement.
    pub fn on_reply(&mut self, reply: &SubmitReply, now: Duration) {
        self.take(reply.accepted, reply.credit, 0, now);
        self.progress(&self.state.clone(), reply.done, None, &[]);
    }

    /// Takes the refusal of line `number`: it, or one before it that had been accepted, is faulty. Returns the error.
    pub fn on_refusal(
        &mut self,
        number: u64,
        refusal: &Error,
        diagnostics: Vec<Diagnostic>,
        now: Duration,
    ) -> Error {
        let line = match refusal.number("expected") {
            Some(expected) if expected > 0 => expected,
            _ if refusal.line() > 0 => refusal.line(),
            _ => number,
        };
        self.window.reject(line.min(number));
        if line < number {
            // lines that were streamed may still be on their way
            self.stragglers = true;
        }
        if let (Some(accepted), Some(credit)) = (refusal.number("accepted"), refusal.number("credit")) {
            self.take(accepted, credit, 0, now);
        }
        self.progress(
            &self.state.clone(),
            refusal.number("done").unwrap_or(0),
            None,
            &[],
        );
        self.extent().rejected(line, diagnostics)
    }

    /// No put of rejected lines is on its way any more: `status` was asked for behind them.
    pub fn settle(&mut self, status: Option<&ProgramStatus>) {
        self.stragglers = false;
        self.failure = None;
        if let Some(status) = status {
            self.progress(
                &status.state,
                status.done,
                status.fault.as_ref(),
                &status.diagnostics,
            );
        }
    }

    pub fn fail(&mut self, error: Option<Error>) {
        self.failure = error.map(|error| Failure {
            error,
            reported: false,
        });
    }

    fn hear_rejection(&mut self, state: &ProgramState, line: u64, accepted: u64, diagnostics: &[Diagnostic]) {
        if line == 0 || accepted + 1 != line {
            return;
        }
        if !state.is_end() {
            self.reject(line, diagnostics);
        } else if *state == ProgramState::Rejected {
            // the program ends there; why is said with its state
            self.window.reject(line);
        }
    }

    /// A streamed line is faulty: it and what follows is given up.
    fn reject(&mut self, line: u64, diagnostics: &[Diagnostic]) {
        if self.judging || self.stragglers || line > self.window.given() {
            return;
        }
        self.window.reject(line);
        self.stragglers = true;
        let error = self.extent().rejected(line, diagnostics.to_vec());
        self.fail(Some(error));
    }

    // ------------------------------------------------------------ what to do

    /// Sends what may be sent, and asks when the server has been silent for too long.
    pub fn next(&mut self, now: Duration) -> Step {
        if !self.judging && self.failure.is_none() {
            if let Some(chunk) = self.window.next_chunk() {
                self.doubt = FIRST_DOUBT;
                return Step::Send(chunk);
            }
        }
        if !self.in_doubt() {
            return Step::Wait;
        }
        let due = self.heard_at.map_or(now, |heard_at| heard_at + self.doubt);
        if now < due {
            return Step::WaitUntil(due);
        }
        self.doubt = (2 * self.doubt).min(LONGEST_DOUBT);
        Step::Ask
    }

    /// Whether something is awaited that a lost acknowledgement could have said.
    fn in_doubt(&self) -> bool {
        if self.ended() || self.judging || !(self.failure.is_none() || self.rejected()) {
            return false;
        }
        self.window.pending() || self.closed || self.done < self.window.accepted()
    }
}
