//! Keys of one machine (docs/keyspace.md); `@v1` and `@rpc` are matched by no wildcard.

use crate::error::{Error, Problem, Result};

pub(crate) const PROTOCOL_VERSION: u64 = 1;
pub(crate) const ALL_MACHINES: &str = "mc/@v1/*/live/*";

/// Whether `text` may stand as one chunk of a key: a machine, a program, a client.
pub(crate) fn is_name(text: &str) -> bool {
    let allowed = |each: u8| each.is_ascii_alphanumeric() || matches!(each, b'_' | b'.' | b'-');
    let bytes = text.as_bytes();
    bytes.len() <= 63
        && bytes.first().is_some_and(u8::is_ascii_alphanumeric)
        && bytes.iter().copied().all(allowed)
}

/// Machine and last chunk of a server's liveliness token `mc/@v1/{machine}/live/{instance}.{session}`.
pub(crate) fn machine_and_server(key: &str) -> Option<(&str, &str)> {
    let mut chunks = key.split('/');
    match (chunks.nth(2), chunks.next(), chunks.next(), chunks.next()) {
        (Some(machine), Some("live"), Some(server), None) => Some((machine, server)),
        _ => None,
    }
}

/// Key expression of the liveliness tokens of one machine's servers; MC537: it is no name of a machine.
pub(crate) fn live_key(machine: &str) -> Result<String> {
    if is_name(machine) {
        return Ok(format!("mc/@v1/{machine}/live/*"));
    }
    Err(Error::Configuration(Box::new(Problem::new(
        "MC537",
        format!("{machine:?} is no name of a machine"),
        "names have letters, digits, '-', '_' and '.', 63 at most",
    ))))
}

/// All keys of one machine, as one client uses them.
#[derive(Debug, Clone)]
pub(crate) struct Keys {
    pub machine: String,
    pub client: String,
}

impl Keys {
    pub fn rpc(&self, method: &str) -> String {
        format!("mc/@v1/{}/@rpc/{}/{method}", self.machine, self.client)
    }

    pub fn lines_in(&self, program: &str) -> String {
        format!("mc/@v1/{}/in/{}/{program}", self.machine, self.client)
    }

    pub fn ack(&self, program: &str) -> String {
        format!("mc/@v1/{}/ack/{program}", self.machine)
    }

    pub fn event(&self) -> String {
        format!("mc/@v1/{}/event", self.machine)
    }

    pub fn samples(&self) -> String {
        format!("mc/@v1/{}/tele/batch", self.machine)
    }

    pub fn state(&self) -> String {
        format!("mc/@v1/{}/tele/state", self.machine)
    }

    pub fn emergency_stop(&self) -> String {
        format!("mc/@v1/{}/estop", self.machine)
    }

    pub fn live(&self) -> String {
        format!("mc/@v1/{}/live/*", self.machine)
    }

    /// Of this client's liveliness token.
    pub fn token(&self) -> String {
        format!("mc/@v1/{}/client/{}", self.machine, self.client)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_one_chunk_without_wildcards() {
        for name in ["cell-1", "a", "9_.x", &"x".repeat(63)] {
            assert!(is_name(name), "{name}");
        }
        for name in ["", "-a", ".a", "a/b", "a*", "@v1", "ä", "a b", &"x".repeat(64)] {
            assert!(!is_name(name), "{name}");
            assert_eq!(live_key(name).unwrap_err().code(), "MC537");
        }
    }

    #[test]
    fn a_token_that_is_none_is_not_read() {
        assert_eq!(
            machine_and_server("mc/@v1/cell/live/1f.2e"),
            Some(("cell", "1f.2e"))
        );
        for key in [
            "mc/@v1/cell/client/1f",
            "mc/@v1/cell/live",
            "mc/@v1/cell/live/1/2",
            "",
        ] {
            assert_eq!(machine_and_server(key), None, "{key}");
        }
    }
}
