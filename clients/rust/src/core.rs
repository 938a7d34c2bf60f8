//! What is known of one program's lines and what is to be done next: a state machine without I/O and without a clock.
//!
//! The driver ([`crate::stream`]) calls it with what it hears and with the time, and carries out the [`Step`] that it
//! answers. So sequences of losses, repeats, rejections and restarts are played in tests without a network.

use std::time::Duration;

use crate::error::{Error, Extent};
use crate::messages::{
    Ack, ContinueReply, Diagnostic, Fault, OpenReply, ProgramState, ProgramStatus, SubmitReply,
};
use crate::window::{Bounds, Chunk, LineWindow};

/// Without an acknowledgement for so long the server is asked; doubled up to the longest while it says nothing new.
pub(crate) const FIRST_DOUBT: Duration = Duration::from_millis(250);
const LONGEST_DOUBT: Duration = Duration::from_secs(2);
/// The server acknowledges targets within 50 ms; one that has not for so long beyond what they count is gone [s].
const UNANSWERED_S: f64 = 0.5;

/// What the driver does next.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Step {
    /// Put these lines, numbered when so many rejections were known.
    Send { chunk: Chunk, rejections: u64 },
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
    /// Rejections of lines that are known. Lines go out with this count, and the server takes none of before a
    /// rejection; what it says with a smaller one is older than what is known.
    rejections: u64,
    /// The last one of a streamed line, which stays when the line has been corrected, and how many there were.
    rejection: Option<Error>,
    heard: u64,
    /// When the server was heard last; none: what is known may be old.
    heard_at: Option<Duration>,
    doubt: Duration,
    /// When targets were sent last since the server was heard, by the sender's clock [s].
    asked: Option<f64>,
    /// How long the server has been silent up to then [s].
    silent: f64,
}

impl Core {
    pub fn new(opened: &OpenReply, bounds: Bounds) -> Self {
        Self {
            program: opened.program.clone(),
            window: LineWindow::new(opened.expected, opened.credit, bounds),
            state: opened.state.clone(),
            done: opened.expected.saturating_sub(1),
            closed: false,
            failure: None,
            judging: false,
            rejections: 0,
            rejection: None,
            heard: 0,
            heard_at: Some(Duration::ZERO),
            doubt: FIRST_DOUBT,
            asked: None,
            silent: 0.0,
        }
    }

    /// Of a program that goes on: lines that the server had already are not done.
    pub fn continuing(opened: &ContinueReply, bounds: Bounds) -> Self {
        let reply = OpenReply {
            program: opened.program.clone(),
            state: opened.state.clone(),
            axes: opened.axes.clone(),
            expected: opened.expected,
            credit: opened.credit,
            instance: opened.instance.clone(),
        };
        Self {
            done: opened.line.saturating_sub(1),
            closed: opened.whole,
            ..Self::new(&reply, bounds)
        }
    }

    // ------------------------------------------------------------ what is known

    pub fn program(&self) -> &str {
        &self.program
    }

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

    pub fn rejections(&self) -> u64 {
        self.rejections
    }

    /// How many rejections of streamed lines were heard of.
    pub fn heard(&self) -> u64 {
        self.heard
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

    /// Before lines are given: returns the failure; a rejection that was reported is over.
    pub fn begin(&mut self) -> Result<(), Error> {
        self.check()?;
        if self.rejected() {
            self.failure = None;
        }
        Ok(())
    }

    /// Returns what has happened since [`Core::begin`], whoever else has heard of it: lines that are given in ignorance
    /// of a rejection would take the numbers of others.
    pub fn check_giving(&mut self) -> Result<(), Error> {
        let Some(failure) = &mut self.failure else {
            return Ok(());
        };
        failure.reported = true;
        Err(failure.error.clone())
    }

    /// Returns why a wait cannot end any more. Each that waits hears of a rejection: what it waits for was given up.
    ///
    /// `past_rejection`: what is before a rejected line is waited for all the same. `before`: [`Core::heard`] as the
    /// wait began.
    pub fn check_wait(&mut self, past_rejection: bool, before: u64) -> Result<(), Error> {
        if let Some(rejection) = self.rejection.clone().filter(|_| !past_rejection && self.heard > before) {
            if self.rejected() {
                let _ = self.check();
            }
            return Err(rejection);
        }
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
        self.check_giving()?;
        if self.ended() {
            return Err(self.extent().closed(&self.state.to_string()));
        }
        if self.closed {
            return Err(self.extent().closed("closed"));
        }
        Ok(())
    }

    /// Sees whether targets can be sent now, by the sender's clock, which count for some seconds.
    pub fn check_targets(&mut self, now: f64, counts: f64) -> Result<(), Error> {
        self.check_open()?;
        if let Some(asked) = self.asked.replace(now) {
            // a sender that stood still for longer has not listened meanwhile
            self.silent += (now - asked).min(UNANSWERED_S);
        }
        if self.silent > counts + UNANSWERED_S {
            return Err(Error::unanswered(self.silent));
        }
        Ok(())
    }

    // ------------------------------------------------------------ what the caller does

    /// Appends a line and returns its number.
    pub fn give(&mut self, line: String) -> u64 {
        self.window.give(line)
    }

    /// Appends a line that a call is about to send; returns its number.
    pub fn give_out(&mut self, line: String) -> u64 {
        let number = self.window.give(line);
        self.window.goes_out(number);
        number
    }

    /// Gives up the lines that have never been sent.
    pub fn abandon(&mut self) {
        self.window.abandon();
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

    /// Takes the answer to [`Step::Ask`]; none: the server knows no such program.
    pub fn on_status(&mut self, status: Option<&ProgramStatus>, now: Duration) {
        let Some(status) = status else {
            self.progress(&ProgramState::Interrupted, 0, None, &[], "");
            return;
        };
        let ack = Ack {
            program: status.program.clone(),
            accepted: status.accepted,
            done: status.done,
            credit: status.credit,
            state: status.state.clone(),
            rejected: status.rejected,
            diagnostics: status.diagnostics.clone(),
            fault: status.fault.clone(),
            expected: 0,
            rejections: status.rejections,
            reason: status.reason.clone(),
        };
        self.on_ack(&ack, now);
        if !self.judging {
            self.window.rewind();
        }
    }

    /// Takes what the server says of the program, which may be older than what is known.
    pub fn on_ack(&mut self, ack: &Ack, now: Duration) {
        self.asked = None;
        self.silent = 0.0;
        if ack.rejections > self.rejections {
            self.hear_rejection(ack, now);
        }
        self.take(ack.accepted, ack.credit, ack.rejections, ack.expected, now);
        if ack.rejections >= self.rejections || ack.state.is_end() {
            self.progress(
                &ack.state,
                ack.done,
                ack.fault.as_ref(),
                &ack.diagnostics,
                &ack.reason,
            );
        }
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

    /// Takes numbers, unless a line before them has been rejected since, or one that is not heard of.
    pub fn take(&mut self, accepted: u64, credit: u64, rejections: u64, expected: u64, now: Duration) {
        self.heard_at = Some(now);
        if rejections == self.rejections {
            self.window.acknowledge(accepted, credit, expected);
        }
    }

    /// Takes the program's state; the first one that is an end stays.
    pub fn progress(
        &mut self,
        state: &ProgramState,
        done: u64,
        fault: Option<&Fault>,
        diagnostics: &[Diagnostic],
        reason: &str,
    ) {
        self.done = self.done.max(done);
        if self.ended() {
            return;
        }
        self.state = state.clone();
        if self.ended() && (self.failure.is_none() || *state != ProgramState::Finished) {
            let ending = self.extent().ending(state, fault, diagnostics, reason);
            self.fail(ending);
        }
    }

    /// Takes the reply to a line under judgement.
    pub fn on_reply(&mut self, reply: &SubmitReply, now: Duration) {
        self.take(reply.accepted, reply.credit, reply.rejections, 0, now);
        self.progress(&self.state.clone(), reply.done, None, &[], "");
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
        self.rejections = self.rejections.max(refusal.number("rejections").unwrap_or(0));
        if let (Some(accepted), Some(credit)) = (refusal.number("accepted"), refusal.number("credit")) {
            self.take(accepted, credit, self.rejections, 0, now);
        }
        self.progress(
            &self.state.clone(),
            refusal.number("done").unwrap_or(0),
            None,
            &[],
            "",
        );
        let rejection = self.extent().rejected(line, diagnostics);
        if line < number {
            // whoever waits for lines that were streamed hears of it too
            self.rejection = Some(rejection.clone());
            self.heard += 1;
        }
        rejection
    }

    pub fn fail(&mut self, error: Option<Error>) {
        self.failure = error.map(|error| Failure {
            error,
            reported: false,
        });
    }

    /// A streamed line is faulty: it and what follows is given up.
    fn hear_rejection(&mut self, ack: &Ack, now: Duration) {
        if self.judging && !ack.state.is_end() {
            return;
        }
        let line = match ack.rejected {
            0 => ack.accepted + 1,
            line => line,
        };
        let lost = line <= self.window.given();
        self.rejections = ack.rejections;
        self.window.reject(line);
        self.take(ack.accepted, ack.credit, ack.rejections, 0, now);
        if lost {
            // where the program has ended otherwise than well, that will be the failure
            let error = self.extent().rejected(line, ack.diagnostics.clone());
            self.rejection = Some(error.clone());
            self.heard += 1;
            self.fail(Some(error));
        }
    }

    // ------------------------------------------------------------ what to do

    /// Sends what may be sent, and asks when the server has been silent for too long.
    pub fn next(&mut self, now: Duration) -> Step {
        if !self.judging && self.failure.is_none() {
            if let Some(chunk) = self.window.next_chunk() {
                self.doubt = FIRST_DOUBT;
                let rejections = self.rejections;
                return Step::Send { chunk, rejections };
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
