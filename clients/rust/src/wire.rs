//! MessagePack to and from the values of [`crate::messages`].

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::error::{Error, Problem};

/// No message is nested so deep; reading costs stack for each level.
const DEEPEST: usize = 64;

pub(crate) const ENCODING: &str = "application/msgpack";

/// Writes a value as MessagePack; structures become maps.
pub(crate) fn encode<T: Serialize + ?Sized>(value: &T) -> Result<Vec<u8>, Error> {
    rmp_serde::to_vec_named(value)
        .map_err(|error| not_understood::<T>(&error, "give numbers, text, lists and maps with text keys"))
}

/// Reads a message; unknown keys are skipped, missing ones get their default.
pub(crate) fn decode<T: DeserializeOwned>(payload: &[u8]) -> Result<T, Error> {
    let mut reader = rmp_serde::Deserializer::from_read_ref(payload);
    reader.set_max_depth(DEEPEST);
    T::deserialize(&mut reader)
        .map_err(|error| not_understood::<T>(&error, "client and server differ in version"))
}

fn not_understood<T: ?Sized>(error: &dyn std::fmt::Display, hint: &str) -> Error {
    let whole = std::any::type_name::<T>();
    let name = whole.rsplit("::").next().unwrap_or(whole);
    Error::Protocol(Box::new(Problem::new(
        "MC533",
        format!("the message is no {name}: {error}"),
        hint,
    )))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::{Ack, Event, ProgramState, ProgramStatus};

    #[test]
    fn a_sparse_acknowledgement_gets_the_defaults_and_unknown_keys_are_skipped() {
        let sent = serde_json::json!({"program": "p", "accepted": 3, "done": 1, "credit": 9,
            "state": "running", "later": {"deep": [1, null]}});
        let ack: Ack = decode(&encode(&sent).unwrap()).unwrap();
        assert_eq!((ack.accepted, ack.rejected, ack.expected), (3, 0, 0));
        assert_eq!(ack.state, ProgramState::Running);
        assert!(ack.fault.is_none() && ack.diagnostics.is_empty());
    }

    #[test]
    fn the_override_of_a_program_is_read_from_the_key_of_that_name() {
        let sent = serde_json::json!({"program": "p", "state": "held", "override": 42.5, "client": "c", "name": "", "axes": [], "start_line": 1, "line": 0,
            "accepted": 0, "done": 0, "credit": 0, "closed": false, "progress": 0.0, "opened_at": 0.0});
        let status: ProgramStatus = decode(&encode(&sent).unwrap()).unwrap();
        assert_eq!(status.override_percent.to_bits(), 42.5_f64.to_bits());
    }

    #[test]
    fn a_state_of_a_later_version_is_no_error() {
        let sent = serde_json::json!({"program": "p", "state": "dreaming", "override": 100.0, "client": "c", "name": "", "axes": [], "start_line": 1, "line": 0,
            "accepted": 0, "done": 0, "credit": 0, "closed": false, "progress": 0.0, "opened_at": 0.0});
        let status: ProgramStatus = decode(&encode(&sent).unwrap()).unwrap();
        assert_eq!(status.state, ProgramState::Later("dreaming".to_owned()));
        assert!(!status.state.is_end());
    }

    #[test]
    fn whatever_the_bytes_are_the_answer_is_a_protocol_error() {
        for garbage in [
            &b""[..],
            b"\xc1",
            b"\xdf\xff\xff\xff\xff",
            b"\x81\xa3seq",
            b"\x90",
            b"text",
        ] {
            assert_eq!(
                decode::<Event>(garbage).unwrap_err().code(),
                "MC533",
                "{garbage:?}"
            );
        }
        let mut deep = vec![0x91; 100_000];
        deep.push(0xc0);
        assert_eq!(decode::<serde_json::Value>(&deep).unwrap_err().code(), "MC533");
    }
}
