//! Remote calls: request numbers, and repetition inside a deadline.
//!
//! An empty answer looks the same whether nobody is there, the server restarts, the caller has no right or the reply
//! was lost. So the same request is sent again with the same number until the deadline; the server gives the same
//! answer again and does nothing twice (docs/wire/calls.md).

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use serde::Serialize;
use tokio::time::Instant;

use crate::error::{Error, Problem, Result};
use crate::keys::Keys;
use crate::link::{Link, Reply};
use crate::messages::ErrorReply;
use crate::presence::Presence;
use crate::wire::{decode, encode};

pub(crate) const DEADLINE: Duration = Duration::from_secs(5);
const ATTEMPT: Duration = Duration::from_secs(2);
const FIRST_PAUSE: Duration = Duration::from_millis(20);
const LONGEST_PAUSE: Duration = Duration::from_millis(250);
/// The server is on its way out, its next start answers.
const STOPPING: &str = "MC515";

/// How long a call is tried.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Trying {
    pub deadline: Duration,
    /// How long one query waits before it is sent again.
    pub attempt: Duration,
    /// The deadline starts anew as long as the server is there: for what waits for motion.
    pub patient: bool,
}

impl Default for Trying {
    fn default() -> Self {
        Self {
            deadline: DEADLINE,
            attempt: ATTEMPT,
            patient: false,
        }
    }
}

impl Trying {
    pub fn within(deadline: Duration) -> Self {
        Self {
            deadline,
            ..Self::default()
        }
    }

    /// For an answer that may take so long: beyond a prompt one the query is not repeated meanwhile.
    pub fn for_answer(deadline: Duration) -> Self {
        Self {
            deadline,
            attempt: if deadline > DEADLINE { deadline } else { ATTEMPT },
            ..Self::default()
        }
    }
}

/// A request with its number.
#[derive(Serialize)]
struct Numbered<'a, T> {
    request: u64,
    #[serde(flatten)]
    fields: &'a T,
}

/// A request without fields.
#[derive(Serialize)]
pub(crate) struct Nothing {}

/// Calls methods of one machine.
#[derive(Clone)]
pub(crate) struct Caller {
    link: Link,
    keys: Arc<Keys>,
    presence: Arc<Presence>,
    numbers: Arc<AtomicU64>,
}

impl Caller {
    pub fn new(link: Link, keys: Arc<Keys>, presence: Arc<Presence>) -> Self {
        Self {
            link,
            keys,
            presence,
            numbers: Arc::new(AtomicU64::new(1)),
        }
    }

    /// Returns the reply's payload.
    pub async fn call<T: Serialize>(&self, method: &str, fields: &T, trying: Trying) -> Result<Vec<u8>> {
        let request = self.numbers.fetch_add(1, Ordering::Relaxed);
        let payload = encode(&Numbered { request, fields })?;
        let key = self.keys.rpc(method);
        let mut until = Instant::now() + trying.deadline;
        let mut pause = FIRST_PAUSE;
        loop {
            if self.link.is_closed() {
                return Err(Error::closed_client());
            }
            let sent_at = Instant::now();
            let remaining = until.saturating_duration_since(sent_at);
            if remaining.is_zero() {
                return Err(self.no_answer(method, trying.deadline));
            }
            let attempt = trying.attempt.min(remaining);
            let replies = self.link.query(&key, payload.clone(), attempt).await;
            let answered = !replies.is_empty();
            if let Some(reply) = replies.into_iter().next() {
                match refusal_of(&reply)? {
                    None => return Ok(reply.payload),
                    Some(error) if error.code() != STOPPING => return Err(error),
                    Some(_) => {}
                }
            }
            if trying.patient && self.presence.online() {
                until = Instant::now() + trying.deadline;
            }
            if answered || sent_at.elapsed() < attempt / 2 {
                // answered empty at once: wait for the server to come, or a little
                let left = until.saturating_duration_since(Instant::now());
                self.presence.wait_for_change(pause.min(left)).await;
                pause = (2 * pause).min(LONGEST_PAUSE);
            }
        }
    }

    fn no_answer(&self, method: &str, deadline: Duration) -> Error {
        let machine = &self.keys.machine;
        if self.presence.online() {
            return Error::NoAnswerInTime(Box::new(
                Problem::new(
                    "MC532",
                    format!("{machine} has not answered {method} within {deadline:?}"),
                    "the server may be busy, or the access rules forbid it; see its log",
                )
                .detail("method", method),
            ));
        }
        Error::NobodyAnswers(Box::new(
            Problem::new(
                "MC530",
                format!("{machine} is no longer there: {method} got no answer within {deadline:?}"),
                "is the server running? list_machines says who answers",
            )
            .detail("method", method),
        ))
    }
}

fn refusal_of(reply: &Reply) -> Result<Option<Error>> {
    if reply.ok {
        return Ok(None);
    }
    Ok(Some(Error::refused(decode::<ErrorReply>(&reply.payload)?)))
}
