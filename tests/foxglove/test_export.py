"""Recordings with the well-known channels beside their own, read by the library's own reader."""

from __future__ import annotations

import io
import json
import re
import shutil
import struct
import subprocess
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from mcserver.cli.app import run_command_line
from mcserver.foxglove.shape import shape_of
from mcserver.machine.machine_file import load_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.recorder.messages import ServiceEvents, StartRecording, StopRecording
from mcserver.recorder.reading import read_recording
from mcserver.service.reports import Event, Fault, LineReport
from mcserver.simulation.recorder import Recorded
from mcserver.simulation.recording_file import write_npz
from mcserver.simulation.tool_poses import ToolPoses
from tests.foxglove.frames import Frames
from tests.recorder.rig import EPOCH, Rig, decoded

Capture = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two seconds of a six-axis arm, with a fault and a line that ended."""
    rig = Rig(tmp_path_factory.mktemp("read"), "arm6")
    rig.give(StartRecording(1, "one"))
    rig.cycles(2000)
    line = LineReport(7, 0.1, 0.5, 0.4, 1.0)
    ended = Event(1, 0.6, "inst", "lines.ended", program="p", lines=[line], wall=EPOCH + 0.6)
    fault = Fault("MC407", "axis 2 lags", axis=2, line=7)
    failed = Event(2, 0.7, "inst", "fault", program="p", line=7, fault=fault, wall=EPOCH + 0.7)
    rig.give(ServiceEvents([ended, failed]))
    rig.give(StopRecording(2))
    rig.settle()
    return rig.folder.finished("one")


@pytest.fixture(scope="module")
def exported(source: Path) -> Path:
    assert run_command_line(["recordings", "export", str(source), "--rate", "20"]) == 0
    return source.with_name("one-foxglove.mcap")


def test_all_of_the_recording_is_still_there(source: Path, exported: Path) -> None:
    before, after = read_recording(source), read_recording(exported)
    np.testing.assert_array_equal(before.cycles.actual, after.cycles.actual)
    assert after.machine == before.machine
    assert after.events == before.events
    assert after.lines == before.lines


def test_the_channels_have_the_published_schemas(exported: Path) -> None:
    with exported.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    schemas = {each.topic: summary.schemas[each.schema_id].name for each in summary.channels.values()}
    assert {topic: name for topic, name in schemas.items() if not name.startswith("mcserver.")} == {
        "/tf": "foxglove.FrameTransforms",
        "/tf_static": "foxglove.FrameTransforms",
        "/joint_states": "foxglove.JointStates",
        "/scene": "foxglove.SceneUpdate",
        "/path": "foxglove.PointCloud",
        "/log": "foxglove.Log",
        "/robot_description": "std_msgs/msg/String",
    }


def test_frames_and_joints_come_at_the_rate_asked_for(exported: Path) -> None:
    for topic in ("/tf", "/joint_states"):
        times = [time_ns for _, time_ns, _ in decoded(exported, topic)]
        assert len(times) == 41
        assert min(np.diff(times[:-1])) > 0.049e9
        assert times[0] == pytest.approx(EPOCH * 1e9, abs=1e6)
        assert times[-1] - times[0] == pytest.approx(1.999e9, abs=1e3)


def test_tips_are_where_the_axes_were_at_that_time(source: Path, exported: Path) -> None:
    cycles = read_recording(source).cycles
    machine = load_machine("arm6")
    kinematics = build_kinematics(machine)
    root = shape_of(machine, kinematics, np.zeros((2, 3))).tree.root
    ((_, _, standing),) = decoded(exported, "/tf_static")
    moving = decoded(exported, "/tf")
    # cycles are a millisecond apart
    at = [round((time_ns - moving[0][1]) / 1e6) for _, time_ns, _ in moving]
    positions = np.radians(cycles.actual[at])
    wanted = ToolPoses(machine, kinematics).of(1, positions)[:, :3]
    frames = [Frames(standing.SerializeToString(), each.SerializeToString()) for _, _, each in moving]
    tips = [each.pose("T1", root)[:3, 3] * 1e3 for each in frames]
    assert np.ptp(wanted, axis=0).max() > 1.0
    np.testing.assert_allclose(tips, wanted, atol=1e-6)


def test_rerun_reads_the_frames_at_their_times_the_path_and_the_links(exported: Path, tmp_path: Path) -> None:
    # its package has 700 MB: not among those that the tests install
    rerun = shutil.which("rerun")
    if rerun is None:
        pytest.skip("rerun is not installed")
    read = tmp_path / "read.rrd"

    def said(*words: str) -> str:
        return subprocess.run([rerun, *words], capture_output=True, text=True, check=True).stdout

    said("mcap", "convert", str(exported), "-o", str(read))
    table = said("rrd", "print", "-vvv", "--entity", "/tf", str(read))
    rows = re.findall(r"┆ (\S+) +┆ \[(\w+)\] +┆ \[(\w+)\] +┆ \[\[(.*?)\]\] +┆ \[\[(.*?)\]\]", table)
    sent = [
        (time_ns, each) for _, time_ns, message in decoded(exported, "/tf") for each in message.transforms
    ]
    assert len(sent) == 6 * 41
    for (time, child, parent, turn, place), (time_ns, each) in zip(rows, sent, strict=True):
        assert (child, parent) == (each.child_frame_id, each.parent_frame_id)
        assert datetime.fromisoformat(f"{time[:26]}+00:00").timestamp() == pytest.approx(
            time_ns / 1e9, abs=1e-5
        )
        for said_of_it, value in ((turn, each.rotation), (place, each.translation)):
            numbers = [number for _, number in value.ListFields()]
            shown = [float(word) for word in said_of_it.split(", ")]
            assert [number for number in shown if number] == pytest.approx(numbers, abs=1e-6)
    everything = said("rrd", "print", str(read))
    assert re.search(r"- /path - data columns: .*Points3D:positions", everything)
    assert "/arm6/visual_geometries/turret/visual_0 " in everything


def test_joints_are_in_si(exported: Path) -> None:
    first = decoded(exported, "/joint_states")[0][2].joints[0]
    # the rig's axis 0 reads 10 mm/s and 0.25 mm of lag as SI, whatever the axis is
    assert first.position == pytest.approx(-0.00025, rel=1e-4)
    assert first.velocity == pytest.approx(0.01, rel=1e-4)
    assert first.effort == pytest.approx(0.5)


def test_a_fault_is_an_error_in_the_log_and_lines_are_not_in_it(exported: Path) -> None:
    ((_, time_ns, log),) = decoded(exported, "/log")
    assert (log.level, log.line, log.file) == (log.ERROR, 7, "p")
    assert "MC407 axis 2 lags" in log.message
    assert time_ns == pytest.approx((EPOCH + 0.7) * 1e9, abs=1e3)


def test_the_path_is_in_the_scene_and_as_points(exported: Path) -> None:
    ((_, _, scene),) = decoded(exported, "/scene")
    ((_, _, points),) = decoded(exported, "/path")
    (line,) = (entity.lines[0] for entity in scene.entities if entity.id.startswith("path"))
    assert len(points.data) == points.point_stride * len(line.points)
    x, y, z = struct.unpack_from("<3f", points.data)
    assert (line.points[0].x, line.points[0].y, line.points[0].z) == pytest.approx((x, y, z), abs=1e-6)


def test_the_urdf_is_in_the_file(exported: Path) -> None:
    with exported.open("rb") as stream:
        ((_, channel, message),) = make_reader(stream).iter_messages(topics=["/robot_description"])
    assert channel.message_encoding == "cdr"
    (length,) = struct.unpack_from("<I", message.data, 4)
    assert message.data[:4] == b"\x00\x01\x00\x00"
    assert message.data[8:].startswith(b"<?xml")
    assert message.data[8 + length - 1 :] == b"\0"


def test_a_simulation_is_exported_too(tmp_path: Path) -> None:
    axes = np.arange(12.0)
    recorded = Recorded(np.zeros(1), np.ones(1), axes, np.zeros((1, 12)), np.zeros((1, 12)))
    stream = io.BytesIO()
    write_npz(recorded, stream)
    (tmp_path / "run.npz").write_bytes(stream.getvalue())
    command = ["recordings", "export", str(tmp_path / "run.npz"), "--machine", "cartesian"]
    assert run_command_line(command) == 0
    assert [topic for topic, _, _ in decoded(tmp_path / "run-foxglove.mcap", "/tf")] == ["/tf"]


def test_a_recording_that_was_cut_off_is_exported_as_far_as_it_goes(source: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    whole = source.read_bytes()
    cut.write_bytes(whole[: whole.index(b"zstd", whole.index(b"zstd") + 4) + 50])
    assert run_command_line(["recordings", "export", str(cut)]) == 0
    times = [time_ns for _, time_ns, _ in decoded(tmp_path / "cut-foxglove.mcap", "/tf")]
    assert 10 < len(times) < 51


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["--machine", "robot-dog"], "MC017"),
        (["--output", "out.txt"], "MC012"),
        (["--output", "nowhere/out.mcap"], "MC013"),
    ],
)
def test_what_does_not_fit_is_refused_and_leaves_no_file(
    source: Path,
    arguments: list[str],
    code: str,
    capfd: Capture,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    copy = tmp_path / "one.mcap"
    copy.write_bytes(source.read_bytes())
    assert run_command_line(["recordings", "export", str(copy), "--json", *arguments]) != 0
    answer = json.loads(capfd.readouterr().out)
    assert answer["ok"] is False
    assert code in json.dumps(answer)
    assert list(tmp_path.iterdir()) == [copy]


def test_what_is_no_recording_is_refused(tmp_path: Path, capfd: Capture) -> None:
    path = tmp_path / "x.mcap"
    path.write_bytes(b"nonsense" * 50)
    assert run_command_line(["recordings", "export", str(path)]) != 0
    assert "MC581" in capfd.readouterr().err
    assert list(tmp_path.iterdir()) == [path]
