//! The connection to one machine, which its handles and programs share.

use std::sync::{Arc, Mutex, PoisonError, RwLock};
use std::time::Duration;

use serde::Serialize;
use serde::de::DeserializeOwned;
use tokio::sync::OnceCell;
use tokio::task::JoinHandle;
use zenoh::liveliness::LivelinessToken;

use crate::calls::{Caller, DEADLINE, Trying};
use crate::discovery::ConnectOptions;
use crate::error::Result;
use crate::events::{EVENTS_LIMIT, EventOrder, NEWEST, fetch, read_events};
use crate::feed::{Feed, Queue};
use crate::keys::Keys;
use crate::link::{Link, Subscription};
use crate::messages::{Done, Event, EventKind, Info, OverrideReply, OverrideRequest, ProgramRequest};
use crate::presence::Presence;
use crate::wire::decode;

/// Ends a task when it is dropped.
struct Running(JoinHandle<()>);

impl Drop for Running {
    fn drop(&mut self) {
        self.0.abort();
    }
}

/// What a machine's handles and programs share.
pub(crate) struct Connection {
    pub link: Link,
    pub keys: Arc<Keys>,
    pub caller: Caller,
    pub patience: Duration,
    pub presence: Arc<Presence>,
    pub options: ConnectOptions,
    pub info: Arc<RwLock<Arc<Info>>>,
    pub token: OnceCell<LivelinessToken>,
    pub watch: Mutex<Option<Subscription>>,
}

impl Connection {
    pub fn info(&self) -> Arc<Info> {
        Arc::clone(&self.info.read().unwrap_or_else(PoisonError::into_inner))
    }

    /// This client's token: without it the server does not notice that the client has gone.
    pub async fn declare_token(&self) -> Result<()> {
        let key = self.keys.token();
        self.token.get_or_try_init(|| self.link.declare_token(&key)).await.map(|_| ())
    }

    pub async fn ask<T: DeserializeOwned>(
        &self,
        method: &str,
        fields: &impl Serialize,
        deadline: Duration,
    ) -> Result<T> {
        decode(&self.caller.call(method, fields, Trying::for_answer(deadline)).await?)
    }

    pub async fn order(&self, method: &str, program: &str) -> Result<()> {
        let request = ProgramRequest {
            program: Some(program.to_owned()),
        };
        self.ask::<Done>(method, &request, DEADLINE).await.map(|_| ())
    }

    pub async fn set_override(&self, percent: f64, program: &str) -> Result<f64> {
        let request = OverrideRequest {
            program: Some(program.to_owned()),
            ..OverrideRequest::new(percent)
        };
        let reply: OverrideReply = self.ask("override", &request, DEADLINE).await?;
        Ok(reply.percent)
    }

    pub async fn feed<T: Send + 'static>(
        &self,
        key: &str,
        limit: usize,
        read: impl Fn(&[u8]) -> Result<T> + Send + Sync + 'static,
    ) -> Result<Feed<T>> {
        let queue = Queue::new(limit);
        let arrived = queue.clone();
        let hear = move |payload: &[u8]| match read(payload) {
            Ok(item) => arrived.push(item),
            Err(error) => tracing::warn!("a message was not understood: {error}"),
        };
        let subscription = self.link.subscribe(key, hear).await?;
        Ok(Feed::new(queue, subscription))
    }

    pub async fn open_events(&self, history: bool, program: Option<String>) -> Result<Feed<Event>> {
        let returns = self.presence.returns();
        let arrived = Queue::new(EVENTS_LIMIT);
        let hearing = arrived.clone();
        let hear = move |payload: &[u8]| match decode::<Event>(payload) {
            Ok(event) => hearing.push(event),
            Err(error) => tracing::warn!("an event was not understood: {error}"),
        };
        let subscription = self.link.subscribe(&self.keys.event(), hear).await?;
        let order = if history {
            EventOrder::default()
        } else {
            EventOrder::behind(&fetch(&self.caller, NEWEST).await?)
        };
        let queue = Queue::new(EVENTS_LIMIT);
        let (passing, missing) = (queue.clone(), queue.clone());
        let pass_on = move |event: Event| {
            if program.is_some() && event.program != program {
                return;
            }
            let last = program.is_some() && event.kind == EventKind::ProgramEnded;
            passing.push(event);
            if last {
                passing.end();
            }
        };
        let reading = tokio::spawn(read_events(
            arrived,
            order,
            self.caller.clone(),
            returns,
            pass_on,
            move |count| missing.miss(count),
            history,
        ));
        Ok(Feed::new(queue, (subscription, Running(reading))))
    }
}
