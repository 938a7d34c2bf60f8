//! The emergency stop: on a session of its own at the highest priority, sent until it is confirmed.

use std::sync::Arc;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use tokio::sync::Notify;
use tokio::time::{Instant, timeout};
use zenoh::qos::Priority;

use crate::discovery::{ConnectOptions, find_machine, random};
use crate::error::{Error, Problem, Result};
use crate::keys::Keys;
use crate::link::{Link, Subscription};
use crate::presence::Presence;
use crate::wire::{decode, encode};

const REPEAT: Duration = Duration::from_millis(50);
const REASON_LENGTH: usize = 200;
// Numbers of stops, which all copies of one have: no counter of requests comes to them.
const LEAST_NUMBER: u64 = 1 << 32;
const MOST_NUMBER: u64 = 1 << 53;

#[derive(Serialize)]
struct EstopRequest {
    request: u64,
    client: String,
    reason: String,
}

/// Of an event and of a state the one field that confirms.
#[derive(Deserialize, Default)]
struct Confirmation {
    #[serde(default)]
    kind: String,
    #[serde(default)]
    state: Option<String>,
}

/// An emergency stop button: a session of its own that is open before it is needed.
///
/// This is a function of a program over a network and no safety function: machines need a circuit of their own.
pub struct EmergencyStop {
    link: Link,
    keys: Keys,
    _watch: Subscription,
}

impl EmergencyStop {
    /// Finds the machine and connects to it, for nothing but stopping.
    ///
    /// # Errors
    /// As [`ConnectOptions::connect`].
    pub async fn connect(options: &ConnectOptions) -> Result<Self> {
        let client = options.client_id()?;
        let link = options.link().await?;
        match Self::on(link.clone(), options, client).await {
            Ok(button) => Ok(button),
            Err(error) => {
                link.close().await;
                Err(error)
            }
        }
    }

    async fn on(link: Link, options: &ConnectOptions, client: String) -> Result<Self> {
        let machine = find_machine(&link, options.machine.as_deref(), options.timeout).await?;
        let presence = Arc::new(Presence::new(&machine));
        let keys = Keys { machine, client };
        let watching = Arc::clone(&presence);
        let watch = link.watch_tokens(&keys.live(), move |key, gone| watching.on_token(key, gone)).await?;
        presence.wait_online(options.timeout).await;
        Ok(Self {
            link: link.believing(&presence),
            keys,
            _watch: watch,
        })
    }

    /// The machine's name.
    #[must_use]
    pub fn machine(&self) -> &str {
        &self.keys.machine
    }

    /// Stops every axis, and returns once the server has confirmed; again is no error.
    ///
    /// # Errors
    /// MC532 no confirmation within the time: use the machine's own circuit.
    pub async fn press(&self, reason: &str, limit: Duration) -> Result<()> {
        send_until_confirmed(&self.link, &self.keys, reason, limit).await
    }

    /// Ends the session.
    pub async fn close(self) {
        self.link.close().await;
    }
}

/// Connects, stops every axis of the machine, and returns its name once the server has confirmed.
///
/// # Errors
/// As [`ConnectOptions::connect`]; MC532 no confirmation within `limit`: use the machine's own circuit.
pub async fn emergency_stop(options: &ConnectOptions, reason: &str, limit: Duration) -> Result<String> {
    let button = EmergencyStop::connect(options).await?;
    let stopped = button.press(reason, limit).await;
    let machine = button.machine().to_owned();
    button.close().await;
    stopped.map(|()| machine)
}

/// Puts the stop again and again until an event or a state says that it is latched.
pub(crate) async fn send_until_confirmed(
    link: &Link,
    keys: &Keys,
    reason: &str,
    limit: Duration,
) -> Result<()> {
    let confirmed = Arc::new(Notify::new());
    let mut subscriptions = Vec::with_capacity(2);
    for key in [keys.event(), keys.state()] {
        let confirmed = Arc::clone(&confirmed);
        let hear = move |payload: &[u8]| {
            let said: Confirmation = decode(payload).unwrap_or_default();
            if said.kind == "estop" || (said.kind.is_empty() && said.state.as_deref() == Some("estop")) {
                confirmed.notify_one();
            }
        };
        subscriptions.push(link.subscribe(&key, hear).await?);
    }
    let request = EstopRequest {
        request: LEAST_NUMBER + random() % (MOST_NUMBER - LEAST_NUMBER),
        client: keys.client.clone(),
        reason: reason.chars().take(REASON_LENGTH).collect(),
    };
    let payload = encode(&request)?;
    let until = Instant::now() + limit;
    loop {
        let left = until.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(Error::NoAnswerInTime(Box::new(Problem::new(
                "MC532",
                format!(
                    "{} has not confirmed the emergency stop within {limit:?}",
                    keys.machine
                ),
                "use the machine's own emergency stop circuit",
            ))));
        }
        let pressed = async {
            link.put(keys.emergency_stop(), payload.clone(), Priority::RealTime).await;
            confirmed.notified().await;
        };
        if timeout(REPEAT.min(left), pressed).await.is_ok() {
            return Ok(());
        }
    }
}
