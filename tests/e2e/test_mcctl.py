"""``mcctl`` against a real server."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path

import numpy as np
import pytest
from mcclient import ProgramAborted, sync

from tests.e2e.conftest import Mcctl
from tests.e2e.servers import ServerProcess


@pytest.fixture
def target(server: ServerProcess) -> tuple[str, ...]:
    """Options that reach the shared server."""
    return ("--machine", server.name, "--connect", server.endpoint)


def written(folder: Path, text: str) -> str:
    path = folder / "part.gcode"
    path.write_text(text, "utf-8")
    return str(path)


def test_run_records_the_path_really_taken(mcctl: Mcctl, target: tuple[str, ...], tmp_path: Path) -> None:
    file = written(tmp_path, "G1010\nG00 X0 Y0\nG94 F12000\nG02 X20 Y20 R20\n")
    done = mcctl("run", file, *target, "--record", str(tmp_path / "out.npz"), "--axes", "0-1")
    assert done.returncode == 0, done.stderr
    with np.load(tmp_path / "out.npz") as recording:
        assert recording["axes"].tolist() == list(range(12))
        arc = recording["setpoint"][recording["line"] == 4][:, :2]
        assert np.diff(recording["time_s"]) == pytest.approx(0.004, abs=1e-6)
    assert np.linalg.norm(arc - (20.0, 0.0), axis=1) == pytest.approx(20.0, abs=0.01)


def test_a_rejected_program_ends_with_4_and_points_at_the_fault(
    mcctl: Mcctl, target: tuple[str, ...], tmp_path: Path
) -> None:
    file = written(tmp_path, "G1010\nG94 F600\nG01 X1\nG02 X100 Y0 R30\n")
    done = mcctl("run", file, *target)
    assert done.returncode == 4, done.stderr
    assert "error[MC104]" in done.stderr
    assert "part.gcode:4:" in done.stderr
    (caret,) = [line for line in done.stderr.splitlines() if "^^^" in line]
    (text,) = [line for line in done.stderr.splitlines() if "G02 X100 Y0 R30" in line]
    assert caret.index("^") == text.index("R30")


def test_zero_is_not_set_behind_a_program_that_has_the_axes(
    mcctl: Mcctl, target: tuple[str, ...], server: ServerProcess
) -> None:
    with (
        sync.Machine.connect(server.name, server.endpoint) as machine,
        contextlib.suppress(ProgramAborted),
        machine.program("slow") as program,
    ):
        program.send_lines(["G1010", "G04 P60"])
        done = mcctl("zero", "X", *target)
        program.abort()
    assert (done.returncode, "MC512" in done.stderr) == (1, True), done.stderr


def test_a_jog_moves_all_of_its_distance(mcctl: Mcctl, target: tuple[str, ...]) -> None:
    def at() -> float:
        return float(json.loads(mcctl("status", "--json", *target).stdout)["axes"]["position"][1])

    before = at()
    done = mcctl("jog", "Y", "4", *target)
    assert done.returncode == 0, done.stderr
    assert at() == pytest.approx(before + 4.0, abs=0.05)


def test_at_a_pause_the_axes_are_jogged_and_the_program_goes_on_from_there(
    mcctl: Mcctl, target: tuple[str, ...], server: ServerProcess
) -> None:
    with (
        sync.Machine.connect(server.name, server.endpoint) as machine,
        machine.program("change") as program,
    ):
        program.send_lines(["G1010", "G94 F30000 G01 X10 Y10", "M00 (fit tool 2)", "G91 G01 X5"])
        while program.state != "paused":
            program.status()
        jogged = mcctl("jog", "Y", "3", *target)
        asked = mcctl("send", "--at-pause", "G94 F6000 G91 G01 X2", *target)
        resumed = mcctl("resume", *target)
    assert (jogged.returncode, asked.returncode, resumed.returncode) == (0, 0, 0), asked.stderr
    places = json.loads(mcctl("status", "--json", *target).stdout)["axes"]["position"]
    assert places[:2] == pytest.approx([17.0, 13.0], abs=0.05)
