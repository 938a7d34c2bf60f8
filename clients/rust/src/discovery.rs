//! Which machines are there, from the servers' liveliness tokens, and how to connect to one.

use std::collections::BTreeSet;
use std::hash::{BuildHasher, Hasher, RandomState};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use tokio::time::{Instant, sleep};

use crate::calls::{Caller, Nothing, Trying};
use crate::error::{Error, Problem, Result};
use crate::keys::{ALL_MACHINES, Keys, is_name, live_key, machine_and_server};
use crate::link::{Link, user_of};
use crate::messages::Info;
use crate::presence::Presence;
use crate::wire::decode;

const CONNECT: Duration = Duration::from_secs(3);
const PATIENCE: Duration = Duration::from_secs(10);
const LOOK_AGAIN: Duration = Duration::from_millis(50);

/// Where to connect, as whom, and how patiently.
///
/// ```no_run
/// # async fn connect() -> mcclient::Result<()> {
/// use mcclient::ConnectOptions;
///
/// let machine = ConnectOptions::new().machine("cell-1").endpoint("tcp/10.0.0.5:7447").connect().await?;
/// # Ok(()) }
/// ```
#[derive(Debug, Clone)]
pub struct ConnectOptions {
    pub(crate) machine: Option<String>,
    pub(crate) endpoints: Vec<String>,
    pub(crate) client: String,
    pub(crate) timeout: Duration,
    pub(crate) patience: Duration,
    pub(crate) config_file: Option<PathBuf>,
}

impl Default for ConnectOptions {
    fn default() -> Self {
        Self::new()
    }
}

impl ConnectOptions {
    /// Begins with the environment's `MC_MACHINE` and `MC_CONNECT`; without them with the only machine of this
    /// computer.
    #[must_use]
    pub fn new() -> Self {
        let variable = |name: &str| std::env::var(name).unwrap_or_default().trim().to_owned();
        let connect = variable("MC_CONNECT");
        let endpoints = connect.split(',').map(str::trim).filter(|each| !each.is_empty());
        Self {
            machine: Some(variable("MC_MACHINE")).filter(|name| !name.is_empty()),
            endpoints: endpoints.map(str::to_owned).collect(),
            client: "rust".to_owned(),
            timeout: CONNECT,
            patience: PATIENCE,
            config_file: None,
        }
    }

    /// Names the machine.
    #[must_use]
    pub fn machine(mut self, name: impl Into<String>) -> Self {
        self.machine = Some(name.into());
        self
    }

    /// Connects to this Zenoh endpoint of a server or router, such as `tcp/10.0.0.5:7447`, instead of the
    /// environment's.
    #[must_use]
    pub fn endpoint(mut self, endpoint: impl Into<String>) -> Self {
        self.endpoints = vec![endpoint.into()];
        self
    }

    /// Sets what the client's id begins with (behind the user that the configuration file names).
    #[must_use]
    pub fn client(mut self, name: impl Into<String>) -> Self {
        self.client = name.into();
        self
    }

    /// Sets how long to look for the machine.
    #[must_use]
    pub fn timeout(mut self, timeout: Duration) -> Self {
        self.timeout = timeout;
        self
    }

    /// Sets how long a program waits for a server that has gone away.
    #[must_use]
    pub fn patience(mut self, patience: Duration) -> Self {
        self.patience = patience;
        self
    }

    /// Uses a Zenoh configuration (JSON5) with certificates and passwords; its endpoints hold.
    #[must_use]
    pub fn config_file(mut self, file: impl Into<PathBuf>) -> Self {
        self.config_file = Some(file.into());
        self.endpoints.clear();
        self
    }

    pub(crate) async fn link(&self) -> Result<Link> {
        if let Some(name) = &self.machine {
            // a name that cannot be one is refused before anything is waited for
            live_key(name)?;
        }
        if self.config_file.is_some() && !self.endpoints.is_empty() {
            return Err(Error::Configuration(Box::new(Problem::new(
                "MC537",
                "an endpoint and a configuration file are given",
                "the file names its endpoints: leave endpoint() out",
            ))));
        }
        Link::open(&self.endpoints, self.timeout, self.config_file.as_deref()).await
    }

    pub(crate) fn client_id(&self) -> Result<String> {
        new_client_id(&self.client, self.config_file.as_deref())
    }
}

/// Makes a client id that nobody else has: `user.name-random`, so that access rules know the user by it.
fn new_client_id(name: &str, config_file: Option<&Path>) -> Result<String> {
    let user = user_of(config_file)?;
    let dot = if user.is_empty() { "" } else { "." };
    let client = format!("{user}{dot}{name}-{:012x}", random() & 0xffff_ffff_ffff);
    if is_name(&client) {
        return Ok(client);
    }
    Err(Error::Configuration(Box::new(Problem::new(
        "MC537",
        format!("{client:?} is no client id"),
        "names have letters, digits, '-', '_' and '.', 63 at most",
    ))))
}

/// 64 bits that differ from process to process and call to call: they have to be unique, not secret.
pub(crate) fn random() -> u64 {
    let mut hasher = RandomState::new().build_hasher();
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    hasher.write_u128(since.as_nanos());
    hasher.write_u32(std::process::id());
    hasher.finish()
}

/// Names of the machines whose tokens are there, sorted.
async fn names(link: &Link, key: &str, limit: Duration) -> Vec<String> {
    let live = link.live_keys(key, limit).await;
    let found: BTreeSet<&str> = live.iter().filter_map(|key| Some(machine_and_server(key)?.0)).collect();
    found.into_iter().map(str::to_owned).collect()
}

/// The machine named, or the only one that is there.
///
/// Only by queries: beside a subscription to the same tokens, or just after its end, Zenoh answers a query from what
/// it has heard so far, and a part of the machines would be taken for all.
pub(crate) async fn find_machine(link: &Link, name: Option<&str>, limit: Duration) -> Result<String> {
    let key = name.map_or(Ok(ALL_MACHINES.to_owned()), live_key)?;
    let until = Instant::now() + limit;
    let mut found = names(link, &key, limit).await;
    while found.is_empty() {
        if Instant::now() > until {
            let others = if name.is_some() {
                names(link, ALL_MACHINES, limit).await
            } else {
                Vec::new()
            };
            return Err(nobody(name, &others));
        }
        sleep(LOOK_AGAIN).await;
        found = names(link, &key, limit).await;
    }
    if found.len() > 1 {
        return Err(Error::SeveralMachines(Box::new(
            Problem::new(
                "MC531",
                format!("{} machines are there: {}", found.len(), found.join(", ")),
                format!("name one, such as ConnectOptions::machine({:?})", found[0]),
            )
            .detail("machines", found),
        )));
    }
    Ok(found.swap_remove(0))
}

/// Lists every machine that is there, with its info or why it gave none.
///
/// # Errors
/// MC530 the endpoint cannot be reached, MC537 the configuration.
pub async fn list_machines(options: &ConnectOptions) -> Result<Vec<(String, Result<Info>)>> {
    let link = options.link().await?;
    let found = ask_all(&link, options).await;
    link.close().await;
    found
}

async fn ask_all(link: &Link, options: &ConnectOptions) -> Result<Vec<(String, Result<Info>)>> {
    let client = options.client_id()?;
    let live = link.live_keys(ALL_MACHINES, options.timeout).await;
    let names: BTreeSet<&str> = live.iter().filter_map(|key| Some(machine_and_server(key)?.0)).collect();
    let mut machines = Vec::new();
    for name in names {
        let presence = Arc::new(Presence::new(name));
        for key in &live {
            presence.on_token(key, false);
        }
        let keys = Arc::new(Keys {
            machine: name.to_owned(),
            client: client.clone(),
        });
        let caller = Caller::new(link.believing(&presence), keys, presence);
        let reply = caller.call("info", &Nothing {}, Trying::within(options.timeout)).await;
        machines.push((name.to_owned(), reply.and_then(|payload| decode(&payload))));
    }
    Ok(machines)
}

fn nobody(name: Option<&str>, others: &[String]) -> Error {
    let problem = match name {
        Some(name) if !others.is_empty() => Problem::new(
            "MC530",
            format!("no machine {name:?} is there"),
            format!("those that are: {}", others.join(", ")),
        )
        .detail("machines", others.to_vec()),
        Some(name) => Problem::new(
            "MC530",
            format!("the network is reached, but not machine {name:?}"),
            "start a server (mcserver run), or name another endpoint",
        ),
        None => Problem::new(
            "MC530",
            "the network is reached, but not any machine",
            "start a server (mcserver run), or name another endpoint",
        ),
    };
    Error::NobodyAnswers(Box::new(problem))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn client_ids_differ_and_one_that_cannot_be_part_of_a_key_is_refused() {
        assert_ne!(
            new_client_id("hmi", None).unwrap(),
            new_client_id("hmi", None).unwrap()
        );
        assert_eq!(new_client_id("a/b", None).unwrap_err().code(), "MC537");
    }

    #[tokio::test]
    async fn an_endpoint_beside_a_configuration_file_is_refused() {
        let options = ConnectOptions::new().config_file("alice.json5").endpoint("tcp/127.0.0.1:7447");
        assert_eq!(options.link().await.err().unwrap().code(), "MC537");
    }

    #[test]
    fn a_machine_that_is_not_there_is_named_beside_those_that_are() {
        let error = nobody(Some("cell-9"), &["cell-1".to_owned()]);
        assert_eq!((error.code(), error.hint()), ("MC530", "those that are: cell-1"));
    }
}
