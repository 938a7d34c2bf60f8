"""Recordings read back as arrays."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest

from mcserver.errors import UsageFault
from mcserver.machine.machine_file import load_machine
from mcserver.recorder.messages import ServiceEvents, StartRecording, StopRecording
from mcserver.recorder.reading import read_recording
from mcserver.service.reports import Event, LineReport
from mcserver.simulation.recorder import Recorded
from mcserver.simulation.recording_file import write_npz
from tests.recorder.rig import EPOCH, Rig


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    rig = Rig(tmp_path_factory.mktemp("read"))
    rig.cycles(1000)
    rig.give(StartRecording(1, "one"))
    rig.cycles(700)
    line = LineReport(7, 1.1, 1.5, 0.4, 1.0)
    rig.give(ServiceEvents([Event(1, 1.6, "inst", "lines.ended", program="p", lines=[line])]))
    rig.give(StopRecording(2))
    rig.settle()
    return rig.folder.finished("one")


def test_a_recording_is_read_back_as_it_was(file: Path) -> None:
    run = read_recording(file)
    cycles = run.cycles
    assert cycles.setpoint.shape == cycles.actual.shape == (700, 12)
    np.testing.assert_allclose(cycles.time_s, 1e-3 * np.arange(700), atol=1e-9)
    np.testing.assert_allclose(cycles.setpoint[:, 0], 10.0 * (1.0 + cycles.time_s), atol=1e-7)
    np.testing.assert_allclose(cycles.setpoint[:, 0] - cycles.actual[:, 0], 0.25, atol=1e-7)
    assert set(cycles.line) == {7.0}
    assert run.start_unix == pytest.approx(EPOCH + 1.0)
    assert run.torque is not None
    assert run.torque[5, 0] == pytest.approx(0.5)


def test_lines_have_the_times_of_the_rows(file: Path) -> None:
    (mark,) = read_recording(file).lines
    assert (mark.start_s, mark.end_s) == (pytest.approx(0.1), pytest.approx(0.5))


def test_the_machine_is_in_the_file_with_its_limits(file: Path) -> None:
    machine = read_recording(file).machine
    assert machine is not None
    assert machine.axes == load_machine("cartesian").axes


def test_a_truncated_recording_is_read_as_far_as_it_goes(file: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    whole = file.read_bytes()
    second = whole.index(b"zstd", whole.index(b"zstd") + 4)
    cut.write_bytes(whole[: second + 50])
    assert 400 <= len(read_recording(cut).cycles.time_s) < 700


def test_an_npz_of_a_simulation_is_a_recording_too(tmp_path: Path) -> None:
    time_s = 0.001 * np.arange(10)
    recorded = Recorded(time_s, np.ones(10), np.array([0.0, 4.0]), np.zeros((10, 2)), np.zeros((10, 2)))
    stream = io.BytesIO()
    write_npz(recorded, stream)
    path = tmp_path / "run.npz"
    path.write_bytes(stream.getvalue())
    run = read_recording(path)
    assert run.machine is None
    assert run.cycles.axes.tolist() == [0.0, 4.0]


@pytest.mark.parametrize("name", ["x.mcap", "x.npz"])
@pytest.mark.parametrize("content", [b"", b"nonsense" * 50, b"PK\x03\x04" + bytes(100), b"\x89MCAP0\r\n"])
def test_what_is_no_recording_is_refused(tmp_path: Path, name: str, content: bytes) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(UsageFault, match="MC581"):
        read_recording(path)


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageFault, match="MC581"):
        read_recording(tmp_path / "none.mcap")
