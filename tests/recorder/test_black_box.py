"""The black box: what it holds, when it is written, and what goes wrong."""

from __future__ import annotations

from pathlib import Path

import pytest

from mcserver.executor.shm.feedback import AxisCondition
from mcserver.recorder.messages import (
    Answer,
    AskStatus,
    SaveBlackBox,
    Saved,
    ServiceEvents,
    StartRecording,
    StopRecording,
    Trouble,
)
from mcserver.service.journal import Journal
from mcserver.service.reports import Event, Fault
from tests.recorder.rig import Rig, column, decoded


def boxes(rig: Rig) -> list[Path]:
    rig.settle()
    return sorted(rig.folder.path.glob("blackbox-*.mcap"))


def test_a_fault_in_the_cycles_is_written_out_with_the_seconds_before_and_behind(tmp_path: Path) -> None:
    rig = Rig(tmp_path, after_s=0.5)
    rig.cycles(3000)
    rig.condition(1, AxisCondition.FAULT)
    rig.cycles(1500)
    (path,) = boxes(rig)
    cycles = decoded(path, "/cycles")
    numbers = column(cycles, "cycle")
    assert numbers[0] == 0
    assert numbers[-1] >= 3500
    faulty = [message.cycle for _, _, message in cycles if message.condition[1] == 8]
    assert faulty[0] == 3000
    assert path.name.endswith("-fault.mcap")


def test_the_name_has_the_code_of_the_fault_that_was_reported(tmp_path: Path) -> None:
    rig = Rig(tmp_path, after_s=0.5)
    rig.cycles(1000)
    rig.condition(1, AxisCondition.FAULT)
    rig.cycles(100)
    rig.give(ServiceEvents([Event(1, 1.0, "inst", "fault", fault=Fault("MC407", "following error"))]))
    rig.cycles(1000)
    (path,) = boxes(rig)
    assert path.name.endswith("-MC407.mcap")
    assert [event["kind"] for _, _, event in decoded(path, "/events")] == ["fault"]


def test_an_emergency_stop_is_written_out(tmp_path: Path) -> None:
    rig = Rig(tmp_path, after_s=0.5)
    rig.cycles(1000)
    rig.stop(latched=True)
    rig.cycles(1000)
    (path,) = boxes(rig)
    assert path.name.endswith("-estop.mcap")


def test_a_fault_that_is_there_from_the_first_cycle_writes_nothing(tmp_path: Path) -> None:
    rig = Rig(tmp_path, after_s=0.5)
    rig.stop(latched=True)
    rig.cycles(2000)
    assert boxes(rig) == []


def come_and_go(rig: Rig, faults: int, *, cycles: int) -> None:
    """Let an axis have faults, each for so many cycles, and as many without one behind it."""
    for _ in range(faults):
        for condition in (AxisCondition.FAULT, AxisCondition.OFF):
            rig.condition(1, condition)
            rig.cycles(cycles)


@pytest.mark.parametrize(("faults", "cycles", "later", "count"), [(20, 200, 0, 1), (2, 500, 31_000, 2)])
def test_faults_one_after_the_other_fill_no_disk_and_are_written_later(
    tmp_path: Path, faults: int, cycles: int, later: int, count: int
) -> None:
    rig = Rig(tmp_path, after_s=0.1)
    rig.cycles(100)
    come_and_go(rig, faults, cycles=cycles)
    rig.cycles(later)
    assert len(boxes(rig)) == count


def test_a_short_box_does_not_lose_the_second_fault_to_the_pause(tmp_path: Path) -> None:
    rig = Rig(tmp_path, minutes=0.1, after_s=0.1)  # 6 s
    rig.cycles(1000)
    come_and_go(rig, 2, cycles=300)
    second = 1600
    rig.cycles(8000)
    found = boxes(rig)
    assert len(found) == 2
    faulty = [message.cycle for _, _, message in decoded(found[1], "/cycles") if message.condition[1] == 8]
    assert second in faulty


def test_values_that_no_float_holds_are_recorded_as_infinite(tmp_path: Path) -> None:
    rig = Rig(tmp_path)
    rig.row.torque[3] = 1e300
    rig.cycles(100)
    rig.give(SaveBlackBox(1))
    (path,) = boxes(rig)
    assert decoded(path, "/cycles")[-1][2].torque[3] == float("inf")


def test_the_box_is_bounded_in_time(tmp_path: Path) -> None:
    rig = Rig(tmp_path, minutes=0.05, after_s=0.1)  # 3 s
    rig.cycles(9000)
    rig.give(SaveBlackBox(1, "look"))
    (path,) = boxes(rig)
    numbers = column(decoded(path, "/cycles"), "cycle")
    assert 3000 <= len(numbers) <= 3600
    assert numbers[-1] == 8999


def test_the_box_is_bounded_in_bytes(tmp_path: Path) -> None:
    rig = Rig(tmp_path, max_mb=1)
    for cycle in range(12):
        # what cannot be compressed
        rig.row.torque[:] = [(cycle * 7919 + axis * 104729) % 1000 / 7.0 for axis in range(rig.axes)]
        rig.cycles(1000)
    rig.give(AskStatus(5))
    (answer,) = [each for each in rig.settle() if isinstance(each, Answer)]
    assert answer.status is not None
    assert 0 < answer.status.held_bytes <= 1 << 20
    assert answer.status.held_s > 1.0


def test_the_box_on_demand_leaves_the_seconds_behind_a_fault_to_the_fault(tmp_path: Path) -> None:
    rig = Rig(tmp_path, after_s=1.0)
    rig.cycles(1000)
    rig.stop(latched=True)
    rig.cycles(200)
    rig.give(SaveBlackBox(3, "look"))
    rig.cycles(2000)
    found = boxes(rig)
    assert [path.name.rpartition("-")[2] for path in found] == ["look.mcap", "estop.mcap"]
    assert column(decoded(found[1], "/cycles"), "cycle")[-1] >= 1999
    (answer,) = [each for each in rig.reports if isinstance(each, Answer)]
    assert (answer.ticket, answer.code, answer.name) == (3, "", found[0].stem)


def test_cycles_that_were_missed_are_counted_and_noted(tmp_path: Path) -> None:
    rig = Rig(tmp_path)
    rig.cycles(500)
    rig.cycles(5000, turns=False)  # the ring holds 2048
    rig.turn()
    rig.give(SaveBlackBox(1))
    (path,) = boxes(rig)
    missed = 5000 - 2048 + 8
    (note,) = [value for _, _, value in decoded(path, "/recorder") if value["kind"] == "gap"]
    assert note["count"] == missed
    assert len(decoded(path, "/cycles")) == 5500 - missed


def test_a_dead_executor_is_written_out_without_waiting_for_cycles(tmp_path: Path) -> None:
    rig = Rig(tmp_path, after_s=2.0)
    rig.cycles(1000)
    rig.recorder.server_lost()
    rig.turn()
    assert rig.recorder.waiting
    rig.clock += 10.0
    rig.turn()
    assert not rig.recorder.waiting
    (path,) = boxes(rig)
    assert path.name.endswith("-server-lost.mcap")


def test_the_program_text_is_in_the_box(tmp_path: Path) -> None:
    rig = Rig(tmp_path)
    journal = Journal(
        tmp_path / "journal.db", call_soon=lambda call: call(), on_failure=lambda _: None, threaded=False
    )
    journal.program_opened(
        "p-1",
        instance="inst",
        client="me",
        name="big",
        axes=[0],
        start_line=1,
        on_disconnect="stop",
        resume_of=None,
        at=0.0,
    )
    journal.lines("p-1", 1, [f"G01 X{number} F100" for number in range(1, 20_001)])
    journal.write_pending()
    rig.cycles(100)
    rig.give(ServiceEvents([Event(1, 0.05, "inst", "lines.started", program="p-1", line=12_000)]))
    rig.give(SaveBlackBox(1))
    (path,) = boxes(rig)
    journal.close()
    parts = [value for _, _, value in decoded(path, "/program")]
    text = {part["first"] + at: line for part in parts for at, line in enumerate(part["lines"])}
    assert text[12_000] == "G01 X12000 F100"
    assert min(text) == 7_000
    assert max(text) == 17_000


@pytest.mark.parametrize("name", ["../evil", "", "a/b", "x" * 101, ".hidden", "a.mcap"])
def test_a_name_that_is_no_plain_name_is_refused(tmp_path: Path, name: str) -> None:
    rig = Rig(tmp_path)
    rig.cycles(10)
    rig.give(StartRecording(1, name))
    (answer,) = [each for each in rig.reports if isinstance(each, Answer)]
    assert answer.code == ("" if name == "" else "MC584")


def test_a_recording_is_not_written_over_another(tmp_path: Path) -> None:
    rig = Rig(tmp_path)
    rig.cycles(100)
    for ticket in (1, 2):
        rig.give(StartRecording(ticket, "same"))
    answers = {each.ticket: each for each in rig.reports if isinstance(each, Answer)}
    assert (answers[1].code, answers[2].code) == ("", "MC584")


def test_stopping_what_is_not_recorded_is_refused(tmp_path: Path) -> None:
    rig = Rig(tmp_path)
    rig.give(StopRecording(1, "none"))
    (answer,) = [each for each in rig.reports if isinstance(each, Answer)]
    assert answer.code == "MC585"


def test_old_boxes_go_and_recordings_stay(tmp_path: Path) -> None:
    rig = Rig(tmp_path, keep=2)
    rig.cycles(100)
    rig.give(StartRecording(1, "mine"))
    rig.cycles(100)
    rig.give(StopRecording(2))
    for ticket in range(3, 8):
        rig.give(SaveBlackBox(ticket))
        rig.cycles(100)
    rig.settle()
    assert len(list(tmp_path.glob("blackbox-*.mcap"))) == 2
    assert (tmp_path / "mine.mcap").exists()


def test_a_folder_that_cannot_be_written_is_reported_and_nothing_else_ends(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    rig = Rig(tmp_path / "file" / "deeper")
    rig.cycles(500)
    rig.give(SaveBlackBox(1))
    rig.cycles(500)
    reports = rig.settle()
    assert [each.code for each in reports if isinstance(each, Trouble)] == ["MC582"]
    (answer,) = [each for each in reports if isinstance(each, Answer)]
    assert (answer.ticket, answer.code) == (1, "MC582")
    assert not [each for each in reports if isinstance(each, Saved)]


def test_a_recording_stops_where_the_disk_has_to_stay_free(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = Rig(tmp_path, min_free=1000)
    room = iter([10_000] * 3)
    monkeypatch.setattr(rig.folder, "room", lambda: next(room, 10))
    rig.give(StartRecording(1, "one"))
    rig.cycles(5000)
    rig.give(StopRecording(2))
    reports = rig.settle()
    assert [each.code for each in reports if isinstance(each, Trouble)] == ["MC582"]
    kept = decoded(rig.folder.finished("one"), "/cycles")
    assert 500 <= len(kept) < 5000
