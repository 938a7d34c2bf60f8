//! The one place that wraps Zenoh: a session in client mode.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use serde_json::{Value, json};
use tokio::runtime::{Handle, RuntimeFlavor};
use tokio::time::{Instant, timeout, timeout_at};
use zenoh::handlers::FifoChannel;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Subscriber;
use zenoh::qos::{CongestionControl, Priority};
use zenoh::query::{ConsolidationMode, QueryTarget};
use zenoh::sample::{Sample, SampleKind};
use zenoh::{Config, Session};

use crate::error::{Error, Problem, Result};
use crate::keys::is_name;
use crate::presence::Presence;
use crate::wire::ENCODING;

pub(crate) const DEFAULT_ENDPOINT: &str = "tcp/127.0.0.1:7447";
const CLOSE_LIMIT: Duration = Duration::from_secs(2);
/// How long a link may be silent: a client that freezes is noticed within it.
const LEASE_MS: u64 = 2000;
const REPLIES_LIMIT: usize = 256;
/// By how much Zenoh may be late with the end of a query.
const OVERTIME: Duration = Duration::from_secs(1);

/// An answer to a query; `ok` is false for an error reply.
#[derive(Debug)]
pub(crate) struct Reply {
    pub payload: Vec<u8>,
    pub ok: bool,
}

/// Whatever delivers until it is dropped.
pub(crate) type Subscription = Subscriber<()>;

/// One Zenoh session, and the server that it believes.
///
/// Anybody whom the network's access rules let may publish on a machine's keys: a sample's source is the session that
/// gave it its time stamp, a reply's the one that replied. What comes from elsewhere than the server is dropped.
#[derive(Clone)]
pub(crate) struct Link {
    session: Session,
    /// Whose replies and samples are taken; none: everybody's, until a machine is chosen.
    presence: Option<Arc<Presence>>,
}

/// Client mode: connects within `limit` at first, and for ever again after a loss; MC537: no Zenoh configuration.
fn configuration(endpoints: &[String], limit: Duration, file: Option<&Path>) -> Result<Config> {
    let milliseconds = u64::try_from(limit.as_millis()).unwrap_or(u64::MAX).max(1);
    let mut settings: Vec<(&str, Value)> = vec![
        ("mode", json!("client")),
        ("connect/timeout_ms", json!(milliseconds)),
        ("connect/exit_on_failure", json!(true)),
        (
            "connect/retry",
            json!({"period_init_ms": 50, "period_max_ms": 500, "period_increase_factor": 1.5}),
        ),
        ("scouting/multicast/enabled", json!(false)),
        ("transport/link/tx/lease", json!(LEASE_MS)),
    ];
    if !endpoints.is_empty() {
        settings.push(("connect/endpoints", json!(endpoints)));
    } else if file.is_none() {
        settings.push(("connect/endpoints", json!([DEFAULT_ENDPOINT])));
    }
    let mut config = match file {
        Some(file) => Config::from_file(file).map_err(|error| refused(&*error))?,
        None => Config::default(),
    };
    for (key, value) in settings {
        config.insert_json5(key, &value.to_string()).map_err(|error| refused(&*error))?;
    }
    Ok(config)
}

/// Reads who the access rules know this client as: `metadata.user` of a Zenoh configuration; empty: nobody.
pub(crate) fn user_of(file: Option<&Path>) -> Result<String> {
    let Some(file) = file else {
        return Ok(String::new());
    };
    let config = Config::from_file(file).map_err(|error| refused(&*error))?;
    let written = config.get_json("metadata").map_err(|error| refused(&*error))?;
    let metadata: Value = serde_json::from_str(&written).unwrap_or_default();
    match metadata.get("user") {
        None => Ok(String::new()),
        Some(Value::String(user)) if user.is_empty() || (is_name(user) && !user.contains('.')) => {
            Ok(user.clone())
        }
        Some(other) => Err(Error::Configuration(Box::new(Problem::new(
            "MC537",
            format!("{}: {other} is no name of a user", file.display()),
            "metadata.user has letters, digits, '-' and '_'",
        )))),
    }
}

/// Zenoh's refusal, without the places in its own sources.
fn refused(error: &dyn std::error::Error) -> Error {
    Error::Configuration(Box::new(Problem::new(
        "MC537",
        format!("Zenoh refuses the configuration: {}", plain(error)),
        "endpoints look like tcp/127.0.0.1:7447",
    )))
}

fn plain(error: &dyn std::error::Error) -> String {
    let whole = error.to_string();
    let words = whole.split_whitespace().filter(|word| !word.contains(".rs:") && *word != "at");
    words.collect::<Vec<_>>().join(" ").trim_end_matches('.').to_owned()
}

impl Link {
    /// Connects; MC530: nothing listens at the endpoints, MC537: Zenoh refuses the configuration.
    pub async fn open(endpoints: &[String], limit: Duration, file: Option<&Path>) -> Result<Self> {
        let multi_thread = Handle::try_current()
            .is_ok_and(|runtime| runtime.runtime_flavor() != RuntimeFlavor::CurrentThread);
        if !multi_thread {
            return Err(Error::Configuration(Box::new(Problem::new(
                "MC537",
                "Zenoh needs tokio's multi-threaded runtime",
                "use #[tokio::main] with the feature rt-multi-thread",
            ))));
        }
        let config = configuration(endpoints, limit, file)?;
        match zenoh::open(config).await {
            Ok(session) => Ok(Self {
                session,
                presence: None,
            }),
            Err(error) => {
                let named = if endpoints.is_empty() {
                    DEFAULT_ENDPOINT.to_owned()
                } else {
                    endpoints.join(", ")
                };
                Err(Error::NobodyAnswers(Box::new(
                    Problem::new(
                        "MC530",
                        format!("nothing can be reached at {named}"),
                        "start a server (mcserver run), or name its endpoint",
                    )
                    .detail("reason", plain(&*error)),
                )))
            }
        }
    }

    /// Returns the same session, of which only this machine's server is believed; tokens are taken from all.
    pub fn believing(&self, presence: &Arc<Presence>) -> Self {
        Self {
            session: self.session.clone(),
            presence: Some(Arc::clone(presence)),
        }
    }

    /// Returns all replies; an empty list says nothing about whether the query arrived.
    pub async fn query(&self, key: &str, payload: Vec<u8>, limit: Duration) -> Vec<Reply> {
        let replies = self
            .session
            .get(key)
            .payload(payload)
            .encoding(ENCODING)
            .timeout(limit)
            .target(QueryTarget::BestMatching)
            .consolidation(ConsolidationMode::None)
            .congestion_control(CongestionControl::Block)
            .priority(Priority::InteractiveHigh)
            .express(true)
            .with(FifoChannel::new(REPLIES_LIMIT))
            .await;
        let replies = match replies {
            Ok(replies) => replies,
            Err(error) => {
                tracing::debug!("query {key}: {error}");
                return Vec::new();
            }
        };
        let mut gathered = Vec::new();
        // Zenoh ends a query at its time-out; a wait of ours does not depend on it
        let until = Instant::now() + limit + OVERTIME;
        while let Ok(Ok(reply)) = timeout_at(until, replies.recv_async()).await {
            let source = reply.replier_id().map(|id| id.zid().to_string());
            if !self.believes(source.as_deref()) {
                continue;
            }
            match reply.result() {
                Ok(sample) => gathered.push(Reply {
                    payload: sample.payload().to_bytes().into_owned(),
                    ok: true,
                }),
                // Zenoh's own error replies (a time-out on the way) are not the server's answer
                Err(error) if error.encoding().to_string() == ENCODING => gathered.push(Reply {
                    payload: error.payload().to_bytes().into_owned(),
                    ok: false,
                }),
                Err(_) => {}
            }
        }
        gathered
    }

    /// Returns the keys of the liveliness tokens that are there now.
    pub async fn live_keys(&self, key: &str, limit: Duration) -> Vec<String> {
        let replies =
            self.session.liveliness().get(key).timeout(limit).with(FifoChannel::new(REPLIES_LIMIT)).await;
        let mut keys = Vec::new();
        match replies {
            Ok(replies) => {
                let until = Instant::now() + limit + OVERTIME;
                while let Ok(Ok(reply)) = timeout_at(until, replies.recv_async()).await {
                    if let Ok(sample) = reply.result() {
                        keys.push(sample.key_expr().to_string());
                    }
                }
            }
            Err(error) => tracing::debug!("liveliness {key}: {error}"),
        }
        keys
    }

    /// Sends; a full link makes a thread beside the runtime's wait. What the link loses is not reported.
    pub async fn put(&self, key: String, payload: Vec<u8>, priority: Priority) {
        let session = self.session.clone();
        let sent = tokio::task::spawn_blocking(move || {
            use zenoh::Wait;
            let put = session
                .put(&key, payload)
                .encoding(ENCODING)
                .priority(priority)
                .express(priority == Priority::RealTime)
                .congestion_control(CongestionControl::Block);
            if let Err(error) = put.wait() {
                tracing::debug!("put {key}: {error}");
            }
        });
        // only a runtime that is shutting down does not run it
        let _ = sent.await;
    }

    /// Sends at once what the next one is newer than: a full link loses it.
    pub fn put_newest(&self, key: &str, payload: Vec<u8>) {
        use zenoh::Wait;
        let put = self
            .session
            .put(key, payload)
            .encoding(ENCODING)
            .priority(Priority::InteractiveHigh)
            .express(true)
            .congestion_control(CongestionControl::Drop);
        if let Err(error) = put.wait() {
            tracing::debug!("put {key}: {error}");
        }
    }

    /// Calls `deliver` with each payload that the server publishes, in a thread of Zenoh's: it must not wait.
    pub async fn subscribe(
        &self,
        key: &str,
        deliver: impl Fn(&[u8]) + Send + Sync + 'static,
    ) -> Result<Subscription> {
        let presence = self.presence.clone();
        let subscriber = self
            .session
            .declare_subscriber(key)
            .callback(move |sample: Sample| {
                let source = sample.timestamp().map(|stamp| stamp.get_id().to_string());
                if presence.as_ref().is_none_or(|presence| presence.is_server(source.as_deref())) {
                    deliver(&sample.payload().to_bytes());
                }
            })
            .await;
        subscriber.map_err(|_| Error::closed_client())
    }

    /// Calls `deliver` as liveliness tokens come and go, those already there too: the key, and whether it has gone.
    pub async fn watch_tokens(
        &self,
        key: &str,
        deliver: impl Fn(&str, bool) + Send + Sync + 'static,
    ) -> Result<Subscription> {
        let subscriber = self
            .session
            .liveliness()
            .declare_subscriber(key)
            .history(true)
            .callback(move |sample: Sample| {
                deliver(sample.key_expr().as_str(), sample.kind() == SampleKind::Delete);
            })
            .await;
        subscriber.map_err(|_| Error::closed_client())
    }

    /// Declares a liveliness token, until it is dropped.
    pub async fn declare_token(&self, key: &str) -> Result<LivelinessToken> {
        let token = self.session.liveliness().declare_token(key).await;
        token.map_err(|_| Error::closed_client())
    }

    pub fn is_closed(&self) -> bool {
        self.session.is_closed()
    }

    /// Ends all that was declared, within [`CLOSE_LIMIT`].
    pub async fn close(&self) {
        let session = self.session.clone();
        let closing = tokio::spawn(async move {
            if let Err(error) = session.close().await {
                tracing::debug!("closing: {error}");
            }
        });
        if timeout(CLOSE_LIMIT, closing).await.is_err() {
            tracing::warn!("Zenoh did not close within {CLOSE_LIMIT:?}");
        }
    }

    fn believes(&self, source: Option<&str>) -> bool {
        self.presence.as_ref().is_none_or(|presence| presence.is_server(source))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_runtime_of_one_thread_is_refused_and_does_not_panic() {
        let error = Link::open(&[], Duration::from_secs(1), None).await.err().unwrap();
        assert_eq!(error.code(), "MC537");
        assert!(error.hint().contains("rt-multi-thread"));
    }

    #[test]
    fn what_is_no_endpoint_is_refused_with_a_code() {
        let error = configuration(&["nonsense".to_owned()], Duration::from_secs(1), None).unwrap_err();
        assert_eq!(error.code(), "MC537");
        assert!(!error.message().contains(".rs:"), "{error}");
    }

    #[test]
    fn a_file_that_is_not_there_is_refused_with_a_code() {
        let file = Path::new("/nowhere/at/all.json5");
        assert_eq!(user_of(Some(file)).unwrap_err().code(), "MC537");
    }
}
