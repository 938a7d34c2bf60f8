"""What is in a recording, read by the MCAP library."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from mcserver.machine.machine_file import builtin_text
from mcserver.recorder.messages import Saved, ServiceEvents, StartRecording, StopRecording
from mcserver.service.reports import Event, Fault, LineReport
from tests.recorder.rig import EPOCH, Rig, column, decoded


def recorded(rig: Rig, cycles: int = 1234) -> Path:
    rig.cycles(50)
    rig.give(StartRecording(1, "one"))
    rig.cycles(cycles)
    rig.turn()
    rig.give(StopRecording(2))
    rig.settle()
    return rig.folder.finished("one")


def test_every_cycle_is_there_once_with_its_values(tmp_path: Path) -> None:
    cycles = decoded(recorded(Rig(tmp_path)), "/cycles")
    numbers = column(cycles, "cycle")
    assert numbers.tolist() == list(range(50, 1284))
    first = cycles[0][2]
    assert cycles[0][1] == pytest.approx((EPOCH + 0.05) * 1e9, abs=1)
    assert first.time == pytest.approx(0.05)
    assert first.line == 7
    assert first.setpoint[0] == pytest.approx(0.5, abs=1e-7)
    assert first.position[0] == pytest.approx(0.25, abs=1e-7)
    assert first.following_error[0] == pytest.approx(0.25)
    assert first.velocity[0] == pytest.approx(10.0)
    assert first.commanded_velocity[0] == pytest.approx(10.0)
    assert first.torque[0] == pytest.approx(0.5)
    assert first.condition[0] == 2
    assert (first.rate[0], first.program_state[0]) == (1.0, 1)
    assert len(first.setpoint) == 12


def test_setpoints_are_fine_enough_to_be_differentiated(tmp_path: Path) -> None:
    position = np.array(
        [message.setpoint[0] for _, _, message in decoded(recorded(Rig(tmp_path)), "/cycles")]
    )
    acceleration = np.diff(position, 2) / 1e-6
    assert np.abs(acceleration).max() < 0.2  # mm/s², of a constant speed


def test_the_summary_says_what_is_there(tmp_path: Path) -> None:
    with recorded(Rig(tmp_path)).open("rb") as stream:
        summary = make_reader(stream, validate_crcs=True).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    by_topic = {channel.topic: channel for channel in summary.channels.values()}
    assert summary.statistics.channel_message_counts[by_topic["/cycles"].id] == 1234
    assert summary.statistics.chunk_count == len(summary.chunk_indexes) >= 2
    assert by_topic["/cycles"].metadata["units"].startswith("mm,mm,mm,deg")
    assert summary.metadata_indexes[0].name == "mcserver"


def test_messages_are_found_by_time_through_the_index(tmp_path: Path) -> None:
    path = recorded(Rig(tmp_path))
    start, end = (int((EPOCH + second) * 1e9) for second in (0.7, 0.8))
    with path.open("rb") as stream:
        found = [
            message.log_time
            for _, _, message in make_reader(stream).iter_messages(
                ["/cycles"], starting_at=start, ending_before=end
            )
        ]
    assert len(found) == 100
    assert found == sorted(found)


def test_events_and_lines_stand_at_their_own_times(tmp_path: Path) -> None:
    rig = Rig(tmp_path)
    rig.give(StartRecording(1, "one"))
    rig.cycles(300)
    lines = [LineReport(4, 0.1, 0.2, 0.1, 1.0), LineReport(5, 0.2, 0.25)]
    rig.give(
        ServiceEvents(
            [
                Event(1, 0.01, "inst", "program.opened", program="p-1", message="square.gcode"),
                Event(2, 0.26, "inst", "lines.ended", program="p-1", lines=lines),
            ]
        )
    )
    rig.give(StopRecording(2))
    rig.settle()
    path = rig.folder.finished("one")
    ((_, at, event),) = decoded(path, "/events")
    assert (event["kind"], event["message"]) == ("program.opened", "square.gcode")
    assert at == pytest.approx((EPOCH + 0.01) * 1e9, abs=1)
    marks = decoded(path, "/lines")
    assert [(mark["line"], mark["program"]) for _, _, mark in marks] == [(4, "p-1"), (5, "p-1")]
    assert marks[0][1] == pytest.approx((EPOCH + 0.2) * 1e9, abs=1)


def test_tools_have_a_channel_each(tmp_path: Path) -> None:
    path = recorded(Rig(tmp_path, "robot-dog"), 500)
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    topics = {channel.topic for channel in summary.channels.values()}
    assert {"/tools/3", "/tools/6", "/tools/9", "/tools/12"} <= topics
    poses = decoded(path, "/tools/3")
    assert len(poses) == 25  # 50 Hz
    assert abs(poses[0][2].z) > 1.0 or abs(poses[0][2].x) > 1.0


def test_inputs_and_outputs_are_there_under_their_names(tmp_path: Path) -> None:
    file = tmp_path / "io.toml"
    file.write_text(
        builtin_text("cartesian")
        + """
[[input]]
number = 3
name = "door"
[[input]]
number = 0
name = "pressure"
kind = "analog"
[[output]]
number = 1
name = "coolant"
"""
    )
    rig = Rig(tmp_path / "recordings", str(file))
    rig.row.inputs[:] = [1.0, 4.5]
    rig.row.outputs[:] = [1.0]
    path = recorded(rig, 100)
    cycle = decoded(path, "/cycles")[-1][2]
    assert (list(cycle.input), list(cycle.output), cycle.program_state[0]) == ([1.0, 4.5], [1.0], 1)
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    (metadata,) = [each.metadata for each in summary.channels.values() if each.topic == "/cycles"]
    assert (metadata["inputs"], metadata["outputs"]) == ("door,pressure", "coolant")


def test_every_schema_is_one_that_its_encoding_can_read(tmp_path: Path) -> None:
    with recorded(Rig(tmp_path)).open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    for schema in summary.schemas.values():
        assert schema.encoding in ("protobuf", "jsonschema")
        if schema.encoding == "jsonschema":
            assert json.loads(schema.data)["type"] == "object"


def test_two_recordings_run_beside_each_other(tmp_path: Path) -> None:
    rig = Rig(tmp_path)
    rig.give(StartRecording(1, "long"))
    rig.cycles(200)
    rig.give(StartRecording(2, "short", max_s=0.3))
    rig.cycles(500)
    rig.give(StopRecording(3, "long"))
    reports = rig.settle()
    assert {report.name for report in reports if isinstance(report, Saved)} == {"long", "short"}
    assert len(decoded(rig.folder.finished("long"), "/cycles")) == 700
    assert 300 <= len(decoded(rig.folder.finished("short"), "/cycles")) <= 400


def test_a_fault_report_is_kept_whole(tmp_path: Path) -> None:
    rig = Rig(tmp_path)
    rig.give(StartRecording(1, "one"))
    rig.cycles(10)
    fault = Fault("MC407", "following error", axis=2, line=9)
    rig.give(ServiceEvents([Event(1, 0.005, "inst", "fault", fault=fault)], lost=3))
    rig.give(StopRecording(2))
    rig.settle()
    path = rig.folder.finished("one")
    assert decoded(path, "/events")[0][2]["fault"]["axis"] == 2
    assert decoded(path, "/recorder")[0][2] == {
        "kind": "events_lost",
        "t": pytest.approx(0.009),
        "count": 3,
        "text": "",
    }
