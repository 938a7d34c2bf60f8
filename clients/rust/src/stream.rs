//! Sends a program's lines and follows what the server says of them: the driver of [`crate::core`].

use std::sync::{Arc, Mutex};
use std::time::Duration;

use tokio::sync::{Notify, watch};
use tokio::task::JoinHandle;
use tokio::time::{Instant, timeout, timeout_at};
use zenoh::qos::Priority;

use crate::calls::{Caller, Trying};
use crate::core::{Core, FIRST_DOUBT, Step};
use crate::error::{Error, Result};
use crate::keys::Keys;
use crate::link::{Link, Subscription};
use crate::messages::{
    Ack, ProgramState, ProgramStatus, ProgramsReply, ProgramsRequest, SubmitReply, SubmitRequest,
};
use crate::presence::{Presence, lock};
use crate::wire::{decode, encode};

const VERDICT_ATTEMPT: Duration = Duration::from_secs(5);
const ENDING: Duration = Duration::from_secs(2);

/// What the callers, the sending task and Zenoh's threads share.
pub(crate) struct Shared {
    pub program: String,
    core: Mutex<Core>,
    changed: watch::Sender<u64>,
    wake: Notify,
    origin: Instant,
    link: Link,
    keys: Arc<Keys>,
    caller: Caller,
    patience: Duration,
}

/// Lines of one program on their way; what it runs ends when it is dropped.
pub(crate) struct LineStream {
    pub shared: Arc<Shared>,
    _subscription: Subscription,
    tasks: [JoinHandle<()>; 2],
}

impl Drop for LineStream {
    fn drop(&mut self) {
        for task in &self.tasks {
            task.abort();
        }
    }
}

/// Ends a judgement, also where the caller's future is dropped.
struct Judging<'a>(&'a Shared);

impl Drop for Judging<'_> {
    fn drop(&mut self) {
        self.0.with(|core, _| core.judge(false));
        self.0.wake.notify_one();
    }
}

/// Lines are being given; where that is not completed, such as by a future that is dropped, what has not been sent is given up.
pub(crate) struct Giving<'a> {
    shared: &'a Shared,
    completed: bool,
}

impl<'a> Giving<'a> {
    pub fn new(shared: &'a Shared) -> Self {
        Self {
            shared,
            completed: false,
        }
    }

    /// All lines are accepted.
    pub fn completed(mut self) {
        self.completed = true;
    }
}

impl Drop for Giving<'_> {
    fn drop(&mut self) {
        if !self.completed {
            self.shared.with(|core, _| core.abandon());
            self.shared.tell();
        }
    }
}

impl LineStream {
    /// Listens to the program's acknowledgements, then begins to send; `patience`: how long the server may be away.
    pub async fn open(
        core: Core,
        link: Link,
        keys: Arc<Keys>,
        caller: Caller,
        presence: &Presence,
        patience: Duration,
    ) -> Result<Self> {
        let shared = Arc::new(Shared {
            program: core.program().to_owned(),
            core: Mutex::new(core),
            changed: watch::Sender::new(0),
            wake: Notify::new(),
            origin: Instant::now(),
            link,
            keys,
            caller,
            patience,
        });
        let hearing = Arc::downgrade(&shared);
        let key = shared.keys.ack(&shared.program);
        let subscription = shared
            .link
            .subscribe(&key, move |payload| {
                if let Some(shared) = hearing.upgrade() {
                    shared.on_ack(payload);
                }
            })
            .await?;
        let sending = tokio::spawn(Arc::clone(&shared).send_and_ask());
        let returning = tokio::spawn(Arc::clone(&shared).watch_returns(presence.returns()));
        Ok(Self {
            shared,
            _subscription: subscription,
            tasks: [sending, returning],
        })
    }
}

impl Shared {
    /// Looks at or changes what is known; `now` is the stream's own time.
    pub fn with<T>(&self, act: impl FnOnce(&mut Core, Duration) -> T) -> T {
        let now = self.origin.elapsed();
        act(&mut lock(&self.core), now)
    }

    /// Wakes whoever waits for a change.
    pub fn tell(&self) {
        self.changed.send_modify(|count| *count += 1);
        self.wake.notify_one();
    }

    // ------------------------------------------------------------ lines and waiting

    /// Appends a line, once there is room; returns its number.
    pub async fn give(&self, text: String) -> Result<u64> {
        if !self.with(|core, _| core.has_room()) {
            self.until(|core| core.has_room() || core.failure().is_some(), false).await?;
        }
        let number = self.with(|core, _| {
            core.check_giving()?;
            Ok(core.give(text))
        });
        self.wake.notify_one();
        number
    }

    /// Until no given line waits for its acceptance.
    pub async fn accepted_all(&self) -> Result<()> {
        self.until(|core| !core.pending(), false).await
    }

    /// Until the condition holds; an error where it no longer can.
    pub async fn until(&self, condition: impl Fn(&Core) -> bool, past_rejection: bool) -> Result<()> {
        let mut changed = self.changed.subscribe();
        let before = self.with(|core, _| core.heard());
        loop {
            let reached = self.with(|core, _| {
                if condition(core) {
                    return Ok(true);
                }
                core.check_wait(past_rejection, before).map(|()| false)
            })?;
            if reached {
                return Ok(());
            }
            self.wake.notify_one();
            if changed.changed().await.is_err() {
                return Err(Error::closed_client());
            }
        }
    }

    /// Sends one line and waits for the verdict on it; returns its number.
    pub async fn submit(&self, text: &str) -> Result<u64> {
        let number = self.with(|core, _| {
            core.judge(true);
            core.give_out(text.to_owned())
        });
        let _judging = Judging(self);
        while self.with(|core, _| core.accepted()) < number {
            self.submit_once(number, text).await?;
            if self.with(|core, _| core.accepted()) < number {
                // no credit: what is before has to be consumed first
                self.hear_of(FIRST_DOUBT).await?;
                self.with(|core, _| core.check())?;
            }
        }
        Ok(number)
    }

    async fn submit_once(&self, number: u64, text: &str) -> Result<()> {
        let request = SubmitRequest {
            rejections: Some(self.with(|core, _| core.rejections())),
            ..SubmitRequest::new(self.program.clone(), number, vec![text.to_owned()])
        };
        let trying = Trying {
            deadline: self.patience,
            attempt: VERDICT_ATTEMPT,
            patient: true,
        };
        match self.caller.call("submit", &request, trying).await {
            Ok(payload) => {
                let reply: SubmitReply = decode(&payload)?;
                self.with(|core, now| core.on_reply(&reply, now));
                self.tell();
                Ok(())
            }
            Err(error @ (Error::NobodyAnswers(_) | Error::NoAnswerInTime(_))) => {
                Err(self.with(|core, _| core.extent()).gone(error))
            }
            Err(error @ Error::RequestRefused(_)) => {
                if !error.diagnostics().is_empty() || error.code() == "MC505" {
                    Err(self.rejection_of(number, error).await?)
                } else {
                    Err(self.translated(error).await)
                }
            }
            Err(other) => Err(other),
        }
    }

    /// The line, or one before it that had been accepted, is faulty.
    async fn rejection_of(&self, number: u64, refusal: Error) -> Result<Error> {
        let mut diagnostics = refusal.diagnostics().to_vec();
        if diagnostics.is_empty() {
            let status = self.ask_status().await?;
            diagnostics = status.map_or_else(Vec::new, |status| status.diagnostics);
            if diagnostics.is_empty() {
                return Ok(refusal);
            }
        }
        let rejection = self.with(|core, now| core.on_refusal(number, &refusal, diagnostics, now));
        self.tell();
        Ok(rejection)
    }

    /// Asks for the program as the server knows it; none: it knows no such program.
    pub async fn ask_status(&self) -> Result<Option<ProgramStatus>> {
        let request = ProgramsRequest {
            program: Some(self.program.clone()),
            limit: 1,
            ..ProgramsRequest::default()
        };
        let trying = Trying::within(self.patience);
        match self.caller.call("programs", &request, trying).await {
            Ok(payload) => {
                let found: ProgramsReply = decode(&payload)?;
                Ok(found.programs.into_iter().find(|each| each.program == self.program))
            }
            Err(error) if error.code() == "MC503" => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// A refusal as what it means for the program: ended, interrupted, or itself.
    pub async fn translated(&self, error: Error) -> Error {
        if !matches!(error.code(), "MC503" | "MC504" | "MC510") {
            return error;
        }
        if let Err(unreachable) = self.resynchronise().await {
            return unreachable;
        }
        let closed = error.code() == "MC510";
        if closed && self.with(|core, _| core.state()) == ProgramState::Ending {
            // why it ends is said once it stands still
            let _ = timeout(ENDING, self.until(Core::ended, true)).await;
        }
        self.with(|core, _| {
            if let Some(failure) = core.failure() {
                return failure.clone();
            }
            if !closed {
                return error;
            }
            let state = error.problem().details.get("state").and_then(|state| state.as_str());
            core.extent().closed(state.unwrap_or("closed"))
        })
    }

    /// Asks what the server has; what it lacks will be sent again.
    pub async fn resynchronise(&self) -> Result<()> {
        match self.ask_status().await {
            Ok(status) => {
                self.with(|core, now| core.on_status(status.as_ref(), now));
                self.tell();
                Ok(())
            }
            Err(error) => Err(self.with(|core, _| core.extent()).gone(error)),
        }
    }

    async fn hear_of(&self, limit: Duration) -> Result<()> {
        let mut changed = self.changed.subscribe();
        if timeout(limit, changed.changed()).await.is_err() {
            self.resynchronise().await?;
        }
        Ok(())
    }

    // ------------------------------------------------------------ what runs beside the callers

    fn on_ack(&self, payload: &[u8]) {
        match decode::<Ack>(payload) {
            Ok(ack) => {
                self.with(|core, now| core.on_ack(&ack, now));
                self.tell();
            }
            Err(error) => tracing::warn!("an acknowledgement was not understood: {error}"),
        }
    }

    async fn watch_returns(self: Arc<Self>, mut returns: watch::Receiver<u64>) {
        while returns.changed().await.is_ok() {
            self.with(|core, _| core.on_server_return());
            self.wake.notify_one();
        }
    }

    /// Sends what may be sent, and asks the server when it has been silent for too long.
    async fn send_and_ask(self: Arc<Self>) {
        loop {
            match self.with(Core::next) {
                Step::Send { chunk, rejections } => match encode(&(chunk.first, chunk.lines, rejections)) {
                    Ok(payload) => {
                        let key = self.keys.lines_in(&self.program);
                        self.link.put(key, payload, Priority::DataHigh).await;
                    }
                    Err(error) => self.with(|core, _| core.fail(Some(error))),
                },
                Step::Ask => {
                    if let Err(error) = self.resynchronise().await {
                        self.with(|core, _| core.fail(Some(error)));
                        self.tell();
                    }
                }
                Step::WaitUntil(due) => {
                    // woken or due: either way it looks again
                    let _ = timeout_at(self.origin + due, self.wake.notified()).await;
                }
                Step::Wait => self.wake.notified().await,
            }
        }
    }
}
