//! The streaming core against a model of the server and a network that loses, repeats and delays.

use std::collections::VecDeque;
use std::time::Duration;

use crate::core::{Core, FIRST_DOUBT, Step};
use crate::error::{Error, Problem};
use crate::messages::{Ack, OpenReply, ProgramState, ProgramStatus};
use crate::window::{Bounds, Chunk};

const NOW: Duration = Duration::ZERO;
const SMALL: Bounds = Bounds {
    buffer_lines: 20,
    buffer_bytes: 200,
    chunk_lines: 6,
    chunk_bytes: 40,
};

/// Numbers that are the same in each run.
struct Random(u64);

impl Random {
    fn below(&mut self, limit: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0 % limit
    }
}

/// Takes line n only if it is the next one, within its credit.
struct Server {
    accepted: u64,
    consumed: u64,
    room: u64,
    taken: Vec<String>,
}

impl Server {
    fn credit(&self) -> u64 {
        self.room - (self.accepted - self.consumed)
    }

    fn receive(&mut self, message: &Chunk) -> Ack {
        let mut expected = 0;
        if message.first > self.accepted + 1 {
            expected = self.accepted + 1;
        } else {
            let known = usize::try_from(self.accepted + 1 - message.first).unwrap();
            let room = usize::try_from(self.credit()).unwrap();
            let new: Vec<String> = message.lines.iter().skip(known).take(room).cloned().collect();
            self.accepted += new.len() as u64;
            self.taken.extend(new);
        }
        ack(self.accepted, self.consumed, self.credit(), expected)
    }

    fn status(&self) -> ProgramStatus {
        status(self.accepted, self.consumed, self.credit())
    }
}

fn ack(accepted: u64, done: u64, credit: u64, expected: u64) -> Ack {
    Ack {
        program: "p".to_owned(),
        accepted,
        done,
        credit,
        state: ProgramState::Running,
        rejected: 0,
        diagnostics: Vec::new(),
        fault: None,
        expected,
        rejections: 0,
        reason: String::new(),
    }
}

fn status(accepted: u64, done: u64, credit: u64) -> ProgramStatus {
    let written = serde_json::json!({"program": "p", "state": "running", "accepted": accepted, "done": done,
        "client": "c", "name": "", "axes": [], "start_line": 1, "line": 0, "closed": false, "override": 100.0,
        "progress": 0.0, "opened_at": 0.0,
        "credit": credit});
    serde_json::from_value(written).unwrap()
}

fn core(credit: u64) -> Core {
    let opened = OpenReply {
        program: "p".to_owned(),
        state: ProgramState::Running,
        axes: vec![0],
        expected: 1,
        credit,
        instance: "i".to_owned(),
    };
    Core::new(&opened, SMALL)
}

fn send_all(core: &mut Core) -> Vec<Chunk> {
    let mut sent = Vec::new();
    while let Step::Send { chunk, .. } = core.next(NOW) {
        sent.push(chunk);
    }
    sent
}

fn stream_over_a_bad_network(seed: u64) {
    let mut random = Random(seed);
    let total = 1 + random.below(60);
    let room = 1 + random.below(30);
    let mut server = Server {
        accepted: 0,
        consumed: 0,
        room,
        taken: Vec::new(),
    };
    let mut core = core(room);
    let texts: Vec<String> = (0..total).map(|n| format!("G01 X{n}")).collect();
    let mut waiting: VecDeque<String> = texts.iter().cloned().collect();
    let mut messages: VecDeque<Chunk> = VecDeque::new();
    let mut acks: VecDeque<Ack> = VecDeque::new();
    for turn in 0..3000 {
        while core.has_room() {
            let Some(line) = waiting.pop_front() else { break };
            core.give(line);
        }
        for chunk in send_all(&mut core) {
            assert!(chunk.first + chunk.lines.len() as u64 - 1 <= core.accepted() + core.credit());
            messages.push_back(chunk);
        }
        // at first anything happens, then the network is well again
        let fate = if turn < 120 {
            random.below(8)
        } else {
            [0, 4, 6, 7][turn % 4]
        };
        match fate {
            0 | 1 => {
                if let Some(message) = messages.pop_front() {
                    acks.push_back(server.receive(&message));
                    if fate == 1 {
                        acks.push_back(server.receive(&message));
                    }
                }
            }
            2 => drop(messages.pop_front()),
            3 if messages.len() > 1 => messages.rotate_left(1),
            4 => {
                if let Some(ack) = acks.pop_front() {
                    core.on_ack(&ack, NOW);
                }
            }
            5 => drop(acks.pop_front()),
            6 => server.consumed = server.accepted,
            7 if turn < 120 || (messages.is_empty() && acks.is_empty()) => {
                core.on_status(Some(&server.status()), NOW);
            }
            _ => {}
        }
        assert_eq!(server.taken, texts[..server.taken.len()], "seed {seed}");
    }
    assert_eq!(server.taken, texts, "seed {seed}");
    assert!(!core.pending() && core.accepted() == total, "seed {seed}");
}

#[test]
fn no_line_is_lost_and_none_is_taken_twice_whatever_the_network_does() {
    for seed in 1_u64..400 {
        stream_over_a_bad_network(0x9e37_79b9_7f4a_7c15_u64.wrapping_mul(seed));
    }
}

#[test]
fn a_gap_is_answered_once_and_not_for_each_message_behind_it() {
    let mut core = core(100);
    for n in 0..20 {
        core.give(format!("G01 X{n}"));
    }
    send_all(&mut core);
    core.on_ack(&ack(0, 0, 100, 1), NOW);
    let again = send_all(&mut core);
    assert_eq!((again[0].first, again.len()), (1, 4));
    core.on_ack(&ack(0, 0, 100, 1), NOW);
    assert!(send_all(&mut core).is_empty());
}

#[test]
fn a_line_longer_than_a_whole_message_is_sent_alone() {
    let mut core = core(100);
    core.give("x".repeat(500));
    assert!(!core.has_room());
    assert_eq!(send_all(&mut core)[0].lines, ["x".repeat(500)]);
}

#[test]
fn the_server_is_asked_after_a_silence_that_doubles_and_not_while_nothing_is_awaited() {
    let mut core = core(100);
    assert_eq!(core.next(Duration::from_secs(60)), Step::Wait);
    core.give("G01 X1".to_owned());
    send_all(&mut core);
    assert_eq!(core.next(NOW), Step::WaitUntil(FIRST_DOUBT));
    assert_eq!(core.next(FIRST_DOUBT), Step::Ask);
    core.on_status(Some(&status(1, 0, 99)), FIRST_DOUBT);
    assert_eq!(core.next(FIRST_DOUBT), Step::WaitUntil(3 * FIRST_DOUBT));
    core.on_status(Some(&status(1, 1, 99)), FIRST_DOUBT);
    assert_eq!(core.next(Duration::from_secs(60)), Step::Wait);
}

#[test]
fn a_server_that_returns_is_asked_at_once_and_the_failure_to_reach_it_is_forgotten() {
    let mut core = core(100);
    core.give("G01 X1".to_owned());
    send_all(&mut core);
    let problem = Problem::new("MC530", "away", "");
    core.fail(Some(Error::NobodyAnswers(Box::new(problem))));
    assert_eq!(core.next(Duration::from_secs(60)), Step::Wait);
    assert_eq!(core.check().unwrap_err().code(), "MC530");
    core.on_server_return();
    assert_eq!(core.next(NOW), Step::Ask);
    core.on_status(Some(&status(0, 0, 100)), NOW);
    assert_eq!(send_all(&mut core).len(), 1);
}

#[test]
fn the_first_end_stays_and_a_later_acknowledgement_does_not_undo_it() {
    let mut core = core(100);
    let mut ended = ack(0, 0, 0, 0);
    ended.state = ProgramState::Aborted;
    core.on_ack(&ended, NOW);
    core.on_ack(&ack(0, 0, 100, 0), NOW);
    assert_eq!(core.state(), ProgramState::Aborted);
    assert_eq!(core.check_open().unwrap_err().code(), "MC535");
}

#[test]
fn a_streamed_line_that_is_faulty_is_reported_once_and_its_number_is_the_next_one() {
    let mut core = core(100);
    for n in 0..3 {
        core.give(format!("G01 X{n}"));
    }
    send_all(&mut core);
    let mut rejected = ack(1, 1, 100, 0);
    rejected.rejected = 2;
    rejected.rejections = 1;
    core.on_ack(&rejected, NOW);
    let error = core.check_wait(false, 0).unwrap_err();
    assert!(
        matches!(&error, Error::ProgramRejected(about) if about.accepted == 1 && about.problem.line == 2)
    );
    assert!(send_all(&mut core).is_empty());
    assert!(core.check().is_ok() && core.check_giving().is_err());
    core.begin().unwrap();
    assert_eq!(core.give("G01 X9".to_owned()), 2);
    assert_eq!(send_all(&mut core)[0].first, 2);
    // made before the corrected line came
    core.on_ack(&rejected, NOW);
    assert!(core.check().is_ok() && core.given() == 2);
}

#[test]
fn lines_that_have_not_gone_out_are_given_up_and_the_next_one_has_the_number_behind_those_that_have() {
    let mut core = core(2);
    for n in 1..6 {
        core.give(format!("G01 X{n}"));
    }
    assert_eq!(send_all(&mut core)[0].lines.len(), 2);
    core.abandon();
    assert_eq!(core.given(), 2);
    core.on_ack(&ack(2, 0, 100, 0), NOW);
    assert!(send_all(&mut core).is_empty());
    assert_eq!(core.give("G01 X9".to_owned()), 3);
    assert_eq!(send_all(&mut core)[0].first, 3);
}
