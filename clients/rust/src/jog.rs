//! Jogging for as long as something holds it: a dead man's switch.

use std::time::Duration;

use tokio::sync::oneshot;
use tokio::task::JoinHandle;
use tokio::time::{MissedTickBehavior, interval};

use crate::calls::{Caller, Trying};
use crate::error::{Error, Problem, Result};
use crate::messages::{Done, JogReply, JogRequest, ProgramRequest};
use crate::wire::decode;

const DEFAULT_HOLD: Duration = Duration::from_millis(500);
const KEEPS_A_HOLD: u32 = 3;

/// A jog that goes on while this is alive.
///
/// It is kept alive by calls every third of the dead man's time; when they stop coming (this program freezes, its link
/// breaks) the axis stops by itself. Dropping it stops the axis too.
#[derive(Debug)]
pub struct HeldJog {
    /// The jog's program id.
    pub program: String,
    release: Option<oneshot::Sender<()>>,
    keeping: Option<JoinHandle<Result<()>>>,
}

impl HeldJog {
    /// Stops the axis within its limits; returns once the stop is ordered.
    ///
    /// # Errors
    /// What ended the jog before: MC510, MC503 at an axis's limit or after an abort; MC532 the link is broken.
    pub async fn stop(mut self) -> Result<()> {
        self.release.take();
        match self.keeping.take() {
            Some(keeping) => keeping.await.unwrap_or_else(|_| Err(Error::closed_client())),
            None => Ok(()),
        }
    }

    /// Whether the jog has ended by itself.
    #[must_use]
    pub fn has_ended(&self) -> bool {
        self.keeping.as_ref().is_none_or(JoinHandle::is_finished)
    }
}

/// Refuses what is no number: it must not reach a machine.
pub(crate) fn finite(value: Option<f64>, name: &str) -> Result<()> {
    if value.is_none_or(f64::is_finite) {
        return Ok(());
    }
    Err(Error::RequestRefused(Box::new(Problem::new(
        "MC511",
        format!("{name} is no finite number"),
        "give a number of mm or deg",
    ))))
}

/// Moves one axis on until the result is stopped or dropped.
pub(crate) async fn jog_held(
    caller: &Caller,
    axis: u64,
    velocity: f64,
    hold: Option<Duration>,
) -> Result<HeldJog> {
    finite(Some(velocity), "velocity")?;
    let hold = hold.unwrap_or(DEFAULT_HOLD);
    let request = JogRequest {
        velocity: Some(velocity),
        hold_s: Some(hold.as_secs_f64()),
        ..JogRequest::new(axis)
    };
    let reply: JogReply = decode(&caller.call("jog", &request, Trying::default()).await?)?;
    let (release, released) = oneshot::channel();
    let keeping = tokio::spawn(keep(
        caller.clone(),
        axis,
        velocity,
        hold,
        reply.program.clone(),
        released,
    ));
    Ok(HeldJog {
        program: reply.program,
        release: Some(release),
        keeping: Some(keeping),
    })
}

async fn keep(
    caller: Caller,
    axis: u64,
    velocity: f64,
    hold: Duration,
    program: String,
    mut released: oneshot::Receiver<()>,
) -> Result<()> {
    let request = JogRequest {
        velocity: Some(velocity),
        hold_s: Some(hold.as_secs_f64()),
        program: Some(program.clone()),
        ..JogRequest::new(axis)
    };
    let mut tick = interval((hold / KEEPS_A_HOLD).max(Duration::from_millis(1)));
    // the first one at once: the jog's own reply may have taken most of the time
    tick.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let kept = loop {
        let keep = async {
            tick.tick().await;
            caller.call("jog", &request, Trying::within(hold)).await
        };
        tokio::select! {
            // dropped or sent: let go
            _ = &mut released => break Ok(()),
            kept = keep => if let Err(error) = kept { break Err(error) },
        }
    };
    // also after an error: it is not known whether the axis still moves
    let stop = ProgramRequest {
        program: Some(program),
    };
    let stopped = caller.call("abort", &stop, Trying::default()).await;
    kept.and_then(|()| decode::<Done>(&stopped?).map(|_| ()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_finite_number_never_reaches_a_machine() {
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert_eq!(finite(Some(value), "velocity").unwrap_err().code(), "MC511");
        }
        assert!(finite(Some(-5.0), "velocity").is_ok() && finite(None, "velocity").is_ok());
    }
}
