//! The files of clients/contract: what passes between server and clients, and what a streaming core makes of it.

use std::collections::VecDeque;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};

use crate::core::{Core, Step};
use crate::error::Error;
use crate::messages::{Info, ProgramStatus, TelemetryBlock};
use crate::servo::{Targets, servo_core};
use crate::telemetry::decode_samples;
use crate::window::Bounds;
use crate::wire::decode;

const NOW: Duration = Duration::ZERO;
/// These decide about lines and places: a client refuses any other value, and has each of their fields.
const DECISIVE: [&str; 7] = [
    "Ack",
    "OpenReply",
    "ContinueReply",
    "SubmitReply",
    "CloseReply",
    "ErrorReply",
    "TelemetryBlock",
];

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../contract")
}

fn read(file: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(file).unwrap()).unwrap()
}

fn files(name: &str) -> Vec<Value> {
    let entries = fs::read_dir(folder().join(name)).unwrap();
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    assert!(!paths.is_empty());
    paths.iter().map(|path| read(path)).collect()
}

fn list<'a>(value: &'a Value, key: &str) -> &'a [Value] {
    value.get(key).and_then(Value::as_array).map_or(&[], Vec::as_slice)
}

fn text<'a>(value: &'a Value, key: &str) -> &'a str {
    value[key].as_str().unwrap()
}

fn bytes(vector: &Value) -> Vec<u8> {
    let digits = text(vector, "bytes").as_bytes();
    let pairs = digits.chunks_exact(2).map(|pair| std::str::from_utf8(pair).unwrap());
    pairs.map(|pair| u8::from_str_radix(pair, 16).unwrap()).collect()
}

/// Equal, where a whole number may be written as a float, and binary data as a list of its bytes.
///
/// Not `whole`: the server may have further fields, which a later version of this crate will have too.
fn same(read: &Value, meant: &Value, whole: bool) -> bool {
    match (read, meant) {
        (Value::Number(a), Value::Number(b)) => {
            a == b
                || (a.is_f64() != b.is_f64() && a.as_f64().map(f64::to_bits) == b.as_f64().map(f64::to_bits))
        }
        (Value::Array(bytes), Value::String(written)) => {
            let decoded = STANDARD.decode(written).unwrap();
            bytes.len() == decoded.len() && bytes.iter().zip(decoded).all(|(each, byte)| *each == json!(byte))
        }
        (Value::Array(a), Value::Array(b)) => {
            a.len() == b.len() && a.iter().zip(b).all(|(a, b)| same(a, b, whole))
        }
        (Value::Object(a), Value::Object(b)) => {
            (a.len() == b.len() || !whole)
                && a.iter().all(|(key, value)| b.get(key).is_some_and(|meant| same(value, meant, whole)))
        }
        _ => read == meant,
    }
}

pub type Read = fn(&[u8]) -> Result<Value, Error>;

pub fn reader<T: DeserializeOwned + Serialize>(payload: &[u8]) -> Result<Value, Error> {
    let message: T = decode(payload)?;
    Ok(serde_json::to_value(message).unwrap())
}

fn block_reader(payload: &[u8]) -> Result<Value, Error> {
    let block: TelemetryBlock = decode(payload)?;
    Ok(json!([block.seq, block.t, STANDARD.encode(block.rows.0)]))
}

/// The reader of a message; none: it is one of a client.
fn reader_of(message: &str) -> Option<Read> {
    if message == "TelemetryBlock" {
        return Some(block_reader);
    }
    crate::contract_readers::reader_of(message)
}

#[test]
fn every_message_of_the_server_is_read_as_it_is_meant() {
    for file in files("messages").iter().filter(|file| text(file, "sent_by") == "server") {
        let name = text(file, "name");
        let Some(read) = reader_of(name) else { continue };
        let whole = DECISIVE.contains(&name);
        for vector in list(file, "vectors").iter().chain(list(file, "later_words")) {
            let where_ = format!("{}, {}", text(file, "name"), text(vector, "name"));
            let value = read(&bytes(vector)).unwrap_or_else(|error| panic!("{where_}: {error}"));
            assert!(
                same(&value, &vector["value"], whole),
                "{where_}:\n{value}\n{}",
                vector["value"]
            );
        }
    }
}

#[test]
fn what_is_no_such_message_is_refused_where_it_decides_about_lines_and_places() {
    for file in files("messages").iter().filter(|file| DECISIVE.contains(&text(file, "name"))) {
        let read = reader_of(text(file, "name")).unwrap();
        for vector in list(file, "refused").iter().filter(|vector| text(vector, "name") != "two messages") {
            let where_ = format!("{}, {}", text(file, "name"), text(vector, "name"));
            let error = read(&bytes(vector)).expect_err(&where_);
            assert_eq!(error.code(), "MC533", "{where_}");
        }
    }
}

#[test]
fn garbage_is_refused_whatever_it_is_taken_for() {
    for vector in list(&read(&folder().join("garbage.json")), "refused") {
        for name in DECISIVE {
            let error = reader_of(name).unwrap()(&bytes(vector)).expect_err(text(vector, "name"));
            assert_eq!(error.code(), "MC533");
        }
    }
}

#[test]
fn samples_are_taken_apart_by_field() {
    let file = read(&folder().join("telemetry.json"));
    let mut info: Info = serde_json::from_value(json!({"machine": "m", "server": "1", "protocol": [1],
        "instance": "i", "epoch": 0.0, "cycle_s": file["cycle_s"], "axes": [], "tools": [], "methods": [],
        "telemetry": {"axes": [], "fields": [], "cycles_a_message": 10, "state_hz": 20.0},
        "limits": {"max_line_length": 100, "max_lines_a_message": 100, "queue_lines": 100, "programs_at_once": 8,
            "open_programs": 64, "remembered_answers": 64, "remembered_answer_s": 60.0}}))
    .unwrap();
    info.telemetry.fields = serde_json::from_value(file["fields"].clone()).unwrap();
    for vector in list(&file, "vectors") {
        info.telemetry.axes = serde_json::from_value(vector["axes"].clone()).unwrap();
        let samples = decode_samples(&bytes(vector), &info).unwrap();
        assert_eq!(
            (json!(samples.seq), json!(samples.rows)),
            (vector["seq"].clone(), vector["rows"].clone())
        );
        assert!(same(&json!(samples.t), &vector["t"], true));
        for (field, column) in vector["columns"].as_object().unwrap() {
            let widened: Vec<f64> = samples.field(field).iter().map(|&value| f64::from(value)).collect();
            assert!(
                same(&json!(widened), column, true),
                "{}: {field}",
                text(vector, "name")
            );
        }
    }
    for vector in list(&file, "refused") {
        info.telemetry.axes = serde_json::from_value(vector["axes"].clone()).unwrap_or_default();
        assert_eq!(decode_samples(&bytes(vector), &info).unwrap_err().code(), "MC533");
    }
}

#[test]
fn every_sequence_goes_as_the_contract_says() {
    for sequence in files("sequences") {
        let chunk_lines = usize::try_from(sequence["chunk_lines"].as_u64().unwrap()).unwrap();
        let mut player = Player::new(chunk_lines);
        for (number, step) in list(&sequence, "steps").iter().enumerate() {
            let (what, value) = step.as_object().unwrap().iter().next().unwrap();
            let place = format!("{}, step {number}, {what}", text(&sequence, "name"));
            player.play(what, value, &place);
        }
    }
}

/// Plays one sequence to a core: what would be sent stands in `sent`.
struct Player {
    chunk_lines: usize,
    core: Option<Core>,
    sent: VecDeque<Value>,
    /// The line under judgement.
    judged: Option<u64>,
    verdict: Option<Error>,
}

impl Player {
    fn new(chunk_lines: usize) -> Self {
        Self {
            chunk_lines,
            core: None,
            sent: VecDeque::new(),
            judged: None,
            verdict: None,
        }
    }

    fn play(&mut self, what: &str, value: &Value, place: &str) {
        let bounds = Bounds {
            chunk_lines: self.chunk_lines,
            ..Bounds::default()
        };
        match what {
            "open" => self.core = Some(Core::new(&decode(&bytes(value)).unwrap(), bounds)),
            "continues" => self.core = Some(Core::continuing(&decode(&bytes(value)).unwrap(), bounds)),
            _ => {}
        }
        let core = self.core.as_mut().unwrap();
        match what {
            "open" | "continues" | "lost" => {}
            "give" => {
                core.begin().unwrap();
                for line in value.as_array().unwrap() {
                    core.give(line.as_str().unwrap().to_owned());
                }
            }
            "judge" => {
                core.begin().unwrap();
                core.judge(true);
                let line = value.as_str().unwrap();
                let number = core.give(line.to_owned());
                self.judged = Some(number);
                self.sent.push_back(json!({"first": number, "lines": [line],
                    "rejections": core.rejections()}));
            }
            "sends" => assert_eq!(self.sent.pop_front().as_ref(), Some(value), "{place}"),
            "quiet" => assert!(self.sent.is_empty(), "{place}: {:?}", self.sent),
            "answer" => match self.judged.take() {
                Some(number) => {
                    if let Some(reply) = value.get("reply") {
                        core.on_reply(&decode(&bytes(reply)).unwrap(), NOW);
                    } else {
                        let refusal = Error::refused(decode(&bytes(&value["refused"])).unwrap());
                        let diagnostics = refusal.diagnostics().to_vec();
                        self.verdict = Some(core.on_refusal(number, &refusal, diagnostics, NOW));
                    }
                    core.judge(false);
                }
                None => core.on_ack(&decode(&bytes(&value["ack"])).unwrap(), NOW),
            },
            "ack" => core.on_ack(&decode(&bytes(value)).unwrap(), NOW),
            "asked" => {
                let status: Option<ProgramStatus> =
                    (!value.is_null()).then(|| decode(&bytes(value)).unwrap());
                core.on_status(status.as_ref(), NOW);
            }
            "closes" => {
                assert_eq!(json!(core.accepted()), value["last"], "{place}");
                core.set_closed();
            }
            "knows" => {
                let known = json!({"accepted": core.accepted(), "done": core.done(), "state": core.state()});
                assert_eq!(&known, value, "{place}");
            }
            "fails" => {
                let error =
                    self.verdict.take().or_else(|| core.check_wait(false, core.heard()).err()).expect(place);
                assert_eq!(error.code(), text(value, "code"), "{place}");
                let says = value["says"].as_str().unwrap_or_default();
                assert!(error.to_string().contains(says), "{place}: {error}");
                if let Some(line) = value.get("line") {
                    assert_eq!(
                        (&json!(error.line()), &json!(error.column())),
                        (line, &value["column"]),
                        "{place}"
                    );
                }
            }
            other => panic!("{place}: a step {other} that is not known here"),
        }
        while let Step::Send { chunk, rejections } = core.next(NOW) {
            let message = json!({"first": chunk.first, "lines": chunk.lines, "rejections": rejections});
            self.sent.push_back(message);
        }
    }
}

#[test]
fn servo_mode_goes_as_the_contract_says() {
    for sequence in files("targets") {
        let mut player = TargetPlayer::default();
        for (number, step) in list(&sequence, "steps").iter().enumerate() {
            let (what, value) = step.as_object().unwrap().iter().next().unwrap();
            let place = format!("{}, step {number}, {what}", text(&sequence, "name"));
            player.play(what, value, &place);
        }
    }
}

/// Plays one sequence of targets.
#[derive(Default)]
struct TargetPlayer {
    core: Option<Core>,
    seq: u64,
    put: Option<Value>,
    status: Option<ProgramStatus>,
    failed: Option<Error>,
}

impl TargetPlayer {
    fn play(&mut self, what: &str, value: &Value, place: &str) {
        match what {
            "servo" => self.core = Some(servo_core(&decode(&bytes(value)).unwrap())),
            "refused" => self.failed = Some(Error::refused(decode(&bytes(value)).unwrap())),
            "targets" => match self.core.as_mut().unwrap().check_targets(
                value["sent"].as_f64().unwrap(),
                value["counts_s"].as_f64().unwrap(),
            ) {
                Err(error) => self.failed = Some(error),
                Ok(()) => self.targets(value),
            },
            "puts" => assert!(same(&self.put.take().unwrap(), value, true), "{place}"),
            "lost" => {}
            "asked" => self.status = Some(decode(&bytes(value)).unwrap()),
            "counts" => {
                let counted = serde_json::to_value(self.status.as_ref().unwrap().servo.as_ref()).unwrap();
                for (name, count) in value.as_object().unwrap() {
                    assert_eq!(&counted[name], count, "{place}: {name}");
                }
            }
            "ack" => self.core.as_mut().unwrap().on_ack(&decode(&bytes(value)).unwrap(), NOW),
            "knows" => assert_eq!(
                json!(self.core.as_ref().unwrap().state()),
                value["state"],
                "{place}"
            ),
            "fails" => {
                let error = self.failed.as_ref().expect(place);
                assert_eq!(error.code(), text(value, "code"), "{place}");
                assert!(
                    error.to_string().contains(text(value, "says")),
                    "{place}: {error}"
                );
                assert_eq!(self.put, None, "{place}");
            }
            other => panic!("{place}: a step {other} that is not known here"),
        }
    }

    fn targets(&mut self, given: &Value) {
        let seconds = |each: &Value| Duration::from_secs_f64(each.as_f64().unwrap());
        let targets = Targets {
            positions: serde_json::from_value(given["positions"].clone()).unwrap(),
            velocities: serde_json::from_value(given["velocities"].clone()).unwrap(),
            times: given["times"].as_array().map(|times| times.iter().map(seconds).collect()),
            counts: Some(seconds(&given["counts_s"])),
            tool: given["tool"].as_u64(),
            in_tool_frame: given["frame"] == "tool",
        };
        self.seq += 1;
        let message = targets.message(self.seq, given["sent"].as_f64().unwrap(), Duration::ZERO);
        self.put = Some(serde_json::to_value(message).unwrap());
    }
}
