//! Whether the server is there, and which start of it: from its liveliness tokens.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::watch;
use tokio::time::timeout;

use crate::keys::machine_and_server;

/// What a lock guards is whole after each statement, so a panic elsewhere does not spoil it.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Servers of one machine that are alive, as `{instance}.{session}`; one is believed as long as it is.
///
/// The token says which Zenoh session speaks for the server, so that whatever comes from another one is known by it.
#[derive(Debug)]
pub(crate) struct Presence {
    machine: String,
    alive: Mutex<Vec<String>>,
    changed: watch::Sender<u64>,
    returned: watch::Sender<u64>,
}

impl Presence {
    pub fn new(machine: &str) -> Self {
        Self {
            machine: machine.to_owned(),
            alive: Mutex::new(Vec::new()),
            changed: watch::Sender::new(0),
            returned: watch::Sender::new(0),
        }
    }

    pub fn online(&self) -> bool {
        !lock(&self.alive).is_empty()
    }

    /// Whether what came from this Zenoh id came from the server; nothing is believed while it is away.
    ///
    /// The one that has been alive for longest is the server: another of the same name is not the one asked.
    pub fn is_server(&self, source: Option<&str>) -> bool {
        source.is_some()
            && lock(&self.alive).first().and_then(|server| server.split_once('.')).map(|(_, session)| session)
                == source
    }

    /// A token has come or gone.
    pub fn on_token(&self, key: &str, gone: bool) {
        let Some((machine, server)) = machine_and_server(key) else {
            return;
        };
        if machine != self.machine {
            return;
        }
        let came_back = {
            let mut alive = lock(&self.alive);
            let before = alive.first().cloned();
            if gone {
                alive.retain(|each| each != server);
            } else if !alive.iter().any(|each| each == server) {
                alive.push(server.to_owned());
            }
            let now = alive.first();
            // at a start, after a lost link, and where the server beside an ended one takes its place
            now.is_some() && (now != before.as_ref() || (!gone && now.is_some_and(|each| each == server)))
        };
        self.changed.send_modify(|count| *count += 1);
        if came_back {
            self.returned.send_modify(|count| *count += 1);
        }
    }

    /// Changes whenever the server comes: at a start, and after a lost link.
    pub fn returns(&self) -> watch::Receiver<u64> {
        self.returned.subscribe()
    }

    /// Until a token comes or goes, or the time is over.
    pub async fn wait_for_change(&self, limit: Duration) {
        let mut changed = self.changed.subscribe();
        // over either way
        let _ = timeout(limit, changed.changed()).await;
    }

    /// Whether the server is there within this time.
    pub async fn wait_online(&self, limit: Duration) -> bool {
        let mut changed = self.changed.subscribe();
        let arrives = async {
            while !self.online() {
                if changed.changed().await.is_err() {
                    return;
                }
            }
        };
        timeout(limit, arrives).await.is_ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn returns(presence: &Presence) -> u64 {
        *presence.returned.borrow()
    }

    #[test]
    fn only_the_server_that_came_first_is_believed_until_its_token_goes() {
        let presence = Presence::new("cell");
        assert!(!presence.is_server(Some("a")) && !presence.is_server(None));
        presence.on_token("mc/@v1/cell/live/1.a", false);
        presence.on_token("mc/@v1/cell/live/1.b", false);
        presence.on_token("mc/@v1/other/live/1.c", false);
        assert!(presence.is_server(Some("a")) && !presence.is_server(Some("b")) && !presence.is_server(None));
        presence.on_token("mc/@v1/cell/live/1.a", true);
        assert!(presence.is_server(Some("b")) && !presence.is_server(Some("a")));
        presence.on_token("mc/@v1/cell/live/1.b", true);
        assert!(!presence.online() && !presence.is_server(None));
    }

    #[test]
    fn a_return_is_seen_at_a_start_after_a_lost_link_and_when_another_takes_its_place() {
        let presence = Presence::new("cell");
        presence.on_token("mc/@v1/cell/live/1.a", false);
        assert_eq!(returns(&presence), 1);
        presence.on_token("mc/@v1/cell/live/1.a", true);
        presence.on_token("mc/@v1/cell/live/1.a", false);
        assert_eq!(returns(&presence), 2);
        presence.on_token("mc/@v1/cell/live/1.b", false);
        assert_eq!(returns(&presence), 2);
        presence.on_token("mc/@v1/cell/live/1.a", true);
        assert_eq!(returns(&presence), 3);
    }
}
