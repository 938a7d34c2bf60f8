//! Errors, each with a stable code and a remedy.

use std::collections::BTreeMap;
use std::fmt;

use serde_json::Value;

use crate::messages::{Diagnostic, ErrorReply, Fault, ProgramState, Severity};

/// Result of this crate.
pub type Result<T> = std::result::Result<T, Error>;

/// What went wrong.
///
/// Codes MC100 to MC529 and MC550 to MC579 come from the server (docs/wire/errors.md), MC530 to MC539 from here:
/// MC530 nobody answers, MC531 several machines, MC532 no answer in time, MC533 not understood, MC534 interrupted,
/// MC535 aborted, MC536 closed, MC537 configuration, MC538 a line that cannot be sent, MC539 the client is closed.
#[derive(Debug, Clone, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An endpoint or option that Zenoh refuses.
    #[error("{0}")]
    Configuration(Box<Problem>),
    /// No machine is there, or no longer.
    #[error("{0}")]
    NobodyAnswers(Box<Problem>),
    /// A machine is there, but a request got no answer within its deadline; it may have been carried out.
    #[error("{0}")]
    NoAnswerInTime(Box<Problem>),
    /// More than one machine is there and none was named; `details["machines"]` lists them.
    #[error("{0}")]
    SeveralMachines(Box<Problem>),
    /// An answer that this version does not understand.
    #[error("{0}")]
    Protocol(Box<Problem>),
    /// The server refuses the request; the state is as it was before.
    #[error("{0}")]
    RequestRefused(Box<Problem>),
    /// A line has faults; nothing of it has moved.
    #[error("{0}")]
    ProgramRejected(Box<ProgramProblem>),
    /// A fault of the machine ended the program.
    #[error("{0}")]
    ProgramFaulted(Box<ProgramProblem>),
    /// The program was stopped before its end; the message says why.
    #[error("{0}")]
    ProgramAborted(Box<ProgramProblem>),
    /// The server that ran the program went away: lines through `done` have surely ended, the one after may have
    /// begun, axes have no energy.
    #[error("{0}")]
    ProgramInterrupted(Box<ProgramProblem>),
    /// The program takes no more lines.
    #[error("{0}")]
    ProgramClosed(Box<ProgramProblem>),
}

/// What an error says.
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct Problem {
    /// Stable code such as MC505.
    pub code: String,
    /// One sentence.
    pub message: String,
    /// The remedy; empty where nothing useful is known.
    pub hint: String,
    /// Place in the program, from 1; 0: none.
    pub line: u64,
    /// Place in the line, from 1; 0: none.
    pub column: u64,
    /// Faults of G-code; empty where the error is about something else.
    pub diagnostics: Vec<Diagnostic>,
    /// Values that the code promises.
    pub details: BTreeMap<String, Value>,
}

/// What an error about one program says.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct ProgramProblem {
    /// Code, message, remedy and place.
    pub problem: Problem,
    /// The program's id.
    pub program: String,
    /// Lines through this number were taken by the server.
    pub accepted: u64,
    /// Lines through this number have surely ended.
    pub done: u64,
    /// Of [`Error::ProgramFaulted`].
    pub fault: Option<Fault>,
}

impl Problem {
    pub(crate) fn new(code: &str, message: impl Into<String>, hint: impl Into<String>) -> Self {
        Self {
            code: code.to_owned(),
            message: message.into(),
            hint: hint.into(),
            ..Self::default()
        }
    }

    pub(crate) fn detail(mut self, name: &str, value: impl Into<Value>) -> Self {
        self.details.insert(name.to_owned(), value.into());
        self
    }

    pub(crate) fn at(mut self, line: u64, diagnostics: Vec<Diagnostic>) -> Self {
        let first = diagnostics.first();
        self.line = if line > 0 {
            line
        } else {
            first.map_or(0, |each| each.line)
        };
        self.column = first.map_or(0, |each| each.column);
        self.diagnostics = diagnostics;
        self
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.code, self.message)?;
        if self.hint.is_empty() {
            return Ok(());
        }
        write!(f, " ({})", self.hint)
    }
}

impl fmt::Display for ProgramProblem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.problem.fmt(f)
    }
}

impl Error {
    /// Code, message, remedy and place.
    #[must_use]
    pub fn problem(&self) -> &Problem {
        match self {
            Self::Configuration(problem)
            | Self::NobodyAnswers(problem)
            | Self::NoAnswerInTime(problem)
            | Self::SeveralMachines(problem)
            | Self::Protocol(problem)
            | Self::RequestRefused(problem) => problem,
            Self::ProgramRejected(about)
            | Self::ProgramFaulted(about)
            | Self::ProgramAborted(about)
            | Self::ProgramInterrupted(about)
            | Self::ProgramClosed(about) => &about.problem,
        }
    }

    /// Of an error about one program: its id, how far it came, the fault.
    #[must_use]
    pub fn program(&self) -> Option<&ProgramProblem> {
        match self {
            Self::ProgramRejected(about)
            | Self::ProgramFaulted(about)
            | Self::ProgramAborted(about)
            | Self::ProgramInterrupted(about)
            | Self::ProgramClosed(about) => Some(about),
            _ => None,
        }
    }

    /// Stable code such as MC505.
    #[must_use]
    pub fn code(&self) -> &str {
        &self.problem().code
    }

    /// One sentence.
    #[must_use]
    pub fn message(&self) -> &str {
        &self.problem().message
    }

    /// The remedy; empty where nothing useful is known.
    #[must_use]
    pub fn hint(&self) -> &str {
        &self.problem().hint
    }

    /// Line of the program, from 1; 0: none.
    #[must_use]
    pub fn line(&self) -> u64 {
        self.problem().line
    }

    /// Column of the line, from 1; 0: none.
    #[must_use]
    pub fn column(&self) -> u64 {
        self.problem().column
    }

    /// Faults of G-code.
    #[must_use]
    pub fn diagnostics(&self) -> &[Diagnostic] {
        &self.problem().diagnostics
    }

    /// A number among the details.
    pub(crate) fn number(&self, name: &str) -> Option<u64> {
        self.problem().details.get(name)?.as_u64()
    }

    pub(crate) fn refused(reply: ErrorReply) -> Self {
        let mut problem = Problem::new(&reply.code, reply.message, reply.hint).at(0, reply.diagnostics);
        problem.details = reply.details;
        Self::RequestRefused(Box::new(problem))
    }

    pub(crate) fn unanswered(silent: f64) -> Self {
        Self::NobodyAnswers(Box::new(Problem::new(
            "MC530",
            format!("the server has not answered for {silent:.1} s"),
            "where it is gone the axes have stopped: once it is there, open servo mode anew",
        )))
    }

    pub(crate) fn closed_client() -> Self {
        Self::NobodyAnswers(Box::new(Problem::new(
            "MC539",
            "the client is closed",
            "connect anew",
        )))
    }
}

/// How far a program came.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Extent {
    pub program: String,
    pub accepted: u64,
    pub done: u64,
}

impl Extent {
    fn about(&self, problem: Problem, fault: Option<Fault>) -> Box<ProgramProblem> {
        Box::new(ProgramProblem {
            problem,
            program: self.program.clone(),
            accepted: self.accepted,
            done: self.done,
            fault,
        })
    }

    /// The error for a program that has ended in this state; none where it has ended well.
    pub fn ending(
        &self,
        state: &ProgramState,
        fault: Option<&Fault>,
        diagnostics: &[Diagnostic],
        reason: &str,
    ) -> Option<Error> {
        match state {
            ProgramState::Finished => None,
            ProgramState::Faulted => Some(self.faulted(fault)),
            ProgramState::Rejected => {
                let line = diagnostics.first().map_or(self.accepted + 1, |each| each.line);
                Some(self.rejected(line, diagnostics.to_vec()))
            }
            ProgramState::Interrupted => Some(self.interrupted()),
            _ => Some(self.aborted(reason)),
        }
    }

    pub fn rejected(&self, line: u64, mut diagnostics: Vec<Diagnostic>) -> Error {
        if diagnostics.is_empty() {
            diagnostics.push(Diagnostic {
                code: "MC100".to_owned(),
                message: format!("line {line} was rejected"),
                line,
                column: 0,
                end_column: 0,
                hint: String::new(),
                severity: Severity::Error,
                tool: None,
                residual_mm: None,
                axis: None,
                edit: None,
            });
        }
        let first = &diagnostics[0];
        let problem =
            Problem::new(&first.code, first.message.clone(), first.hint.clone()).at(line, diagnostics);
        Error::ProgramRejected(self.about(problem, None))
    }

    fn faulted(&self, fault: Option<&Fault>) -> Error {
        let fault = fault.cloned().unwrap_or_else(|| Fault {
            code: "MC400".to_owned(),
            message: "a fault of the machine ended the program".to_owned(),
            hint: String::new(),
            axis: None,
            line: 0,
            program: None,
            t: 0.0,
        });
        let hint = if fault.hint.is_empty() {
            "clear the fault with reset, then capture the axes (G1010)"
        } else {
            &fault.hint
        };
        let problem = Problem::new(&fault.code, fault.message.clone(), hint).at(fault.line, Vec::new());
        Error::ProgramFaulted(self.about(problem, Some(fault)))
    }

    fn aborted(&self, reason: &str) -> Error {
        let why = if reason.is_empty() {
            String::new()
        } else {
            format!(" ({reason})")
        };
        let problem = Problem::new(
            "MC535",
            format!(
                "the program was aborted{why}; lines through {} are done",
                self.done
            ),
            "once the machine is clear, open another one",
        );
        Error::ProgramAborted(self.about(problem, None))
    }

    fn interrupted(&self) -> Error {
        let following = self.done + 1;
        let problem = Problem::new(
            "MC534",
            format!(
                "the server that ran the program went away; lines through {} are done, line {following} may have begun",
                self.done
            ),
            format!(
                "Machine::continue_program with ContinueRequest::new({:?}) goes on",
                self.program
            ),
        );
        Error::ProgramInterrupted(self.about(problem, None))
    }

    /// It takes no more lines: `state` says why.
    pub fn closed(&self, state: &str) -> Error {
        let problem = Problem::new(
            "MC536",
            format!("the program takes no more lines: it is {state}"),
            "open another one with Machine::program",
        );
        Error::ProgramClosed(self.about(problem, None))
    }

    /// `error` is that nobody answers: with how far the program is known to have come.
    pub fn gone(&self, error: Error) -> Error {
        let complete = |problem: Box<Problem>| {
            let message = format!(
                "{}; of program {} lines through {} were accepted and through {} done",
                problem.message, self.program, self.accepted, self.done
            );
            let hint = "once the server is back, Machine::programs says how far it came";
            Box::new(
                Problem::new(&problem.code, message, hint)
                    .detail("program", self.program.clone())
                    .detail("accepted", self.accepted)
                    .detail("done", self.done),
            )
        };
        match error {
            Error::NobodyAnswers(problem) => Error::NobodyAnswers(complete(problem)),
            Error::NoAnswerInTime(problem) => Error::NoAnswerInTime(complete(problem)),
            other => other,
        }
    }
}
