//! Numbering, credit and repetition of one program's lines: a state machine without I/O.
//!
//! The client numbers lines. The server takes line n only if it is the next one; a repeat is acknowledged and never
//! executed again, a gap is refused. So whatever is not known to be accepted may be sent again at any time, and must
//! be until it is: nothing is lost and nothing runs twice (docs/wire/lines.md).

use std::collections::VecDeque;

/// What waits for its acknowledgement at most: bounds memory, what a loss repeats, and how long a put can block.
const BUFFER_LINES: usize = 16_384;
const BUFFER_BYTES: usize = 512 * 1024;
const CHUNK_LINES: usize = 1000;
const CHUNK_BYTES: usize = 64 * 1024;

/// Lines `first`, `first + 1`, … to be sent.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Chunk {
    pub first: u64,
    pub lines: Vec<String>,
}

/// Bounds of what waits and of what is sent at once.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bounds {
    pub buffer_lines: usize,
    pub buffer_bytes: usize,
    pub chunk_lines: usize,
    pub chunk_bytes: usize,
}

impl Default for Bounds {
    fn default() -> Self {
        Self {
            buffer_lines: BUFFER_LINES,
            buffer_bytes: BUFFER_BYTES,
            chunk_lines: CHUNK_LINES,
            chunk_bytes: CHUNK_BYTES,
        }
    }
}

/// The lines between the last one accepted and the last one given.
#[derive(Debug)]
pub(crate) struct LineWindow {
    accepted: u64,
    credit: u64,
    sent: u64,
    /// The last line that has ever gone out: it may arrive, even where it is to be sent again.
    went_out: u64,
    lines: VecDeque<String>,
    bytes: usize,
    bounds: Bounds,
    /// The gap that has been answered by going back; its echoes, one for each message behind it, are not.
    gap_answered: u64,
}

impl LineWindow {
    /// Begins before line `first`, of which the server takes `credit` lines now.
    pub fn new(first: u64, credit: u64, bounds: Bounds) -> Self {
        let before = first.saturating_sub(1);
        Self {
            accepted: before,
            credit,
            sent: before,
            went_out: before,
            lines: VecDeque::new(),
            bytes: 0,
            bounds,
            gap_answered: 0,
        }
    }

    pub fn accepted(&self) -> u64 {
        self.accepted
    }

    pub fn credit(&self) -> u64 {
        self.credit
    }

    /// Number of the last line given.
    pub fn given(&self) -> u64 {
        self.accepted + self.lines.len() as u64
    }

    /// Whether another line may be given: always where none waits, so that a long line cannot stick.
    pub fn has_room(&self) -> bool {
        self.lines.is_empty()
            || (self.lines.len() < self.bounds.buffer_lines && self.bytes < self.bounds.buffer_bytes)
    }

    /// Whether lines have been given that are not known to be accepted.
    pub fn pending(&self) -> bool {
        !self.lines.is_empty()
    }

    /// Appends a line and returns its number.
    pub fn give(&mut self, line: String) -> u64 {
        self.bytes += line.len();
        self.lines.push_back(line);
        self.given()
    }

    /// What to send now, within the credit; it counts as sent.
    pub fn next_chunk(&mut self) -> Option<Chunk> {
        let first = self.sent + 1;
        let through = self
            .given()
            .min(self.accepted.saturating_add(self.credit))
            .min(self.sent + self.bounds.chunk_lines as u64);
        if through < first {
            return None;
        }
        let offset = usize::try_from(self.sent - self.accepted).ok()?;
        let count = usize::try_from(through - self.sent).ok()?;
        let mut lines = Vec::with_capacity(count);
        let mut size = 0;
        for line in self.lines.iter().skip(offset).take(count) {
            size += line.len();
            if size > self.bounds.chunk_bytes && !lines.is_empty() {
                break;
            }
            lines.push(line.clone());
        }
        self.sent += lines.len() as u64;
        self.goes_out(self.sent);
        Some(Chunk { first, lines })
    }

    /// Notes that lines through this number are on their way.
    pub fn goes_out(&mut self, number: u64) {
        self.went_out = self.went_out.max(number);
    }

    /// Gives up the lines that have never been sent; the others may be accepted.
    pub fn abandon(&mut self) {
        while self.given() > self.went_out {
            let Some(text) = self.lines.pop_back() else { break };
            self.bytes -= text.len();
        }
    }

    /// Takes a cumulative acknowledgement; one that is older than what is known changes nothing.
    ///
    /// `expected`: a message left a gap and this line is expected; 0: no gap.
    pub fn acknowledge(&mut self, accepted: u64, credit: u64, expected: u64) {
        if accepted < self.accepted || accepted > self.given() {
            return;
        }
        for _ in self.accepted..accepted {
            if let Some(line) = self.lines.pop_front() {
                self.bytes -= line.len();
            }
        }
        self.accepted = accepted;
        self.sent = self.sent.max(accepted);
        self.credit = credit;
        if expected == accepted + 1 && self.sent > accepted && self.gap_answered != expected {
            self.gap_answered = expected;
            self.sent = accepted;
        }
    }

    /// Everything that is not known to be accepted will be sent again.
    pub fn rewind(&mut self) {
        self.sent = self.accepted;
    }

    /// Line `line` is faulty: it and what follows is given up, and `line` is the next number.
    ///
    /// A line that was accepted before may turn out faulty: acceptance steps back.
    pub fn reject(&mut self, line: u64) {
        if line == 0 || line > self.given() {
            return;
        }
        while self.given() >= line {
            let Some(text) = self.lines.pop_back() else { break };
            self.bytes -= text.len();
        }
        self.accepted = self.accepted.min(line - 1);
        self.sent = self.sent.min(self.given());
        self.went_out = self.went_out.min(self.given());
        self.gap_answered = 0;
    }
}
