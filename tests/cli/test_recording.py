"""The files of ``--output``."""

from __future__ import annotations

import io
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mcserver.cli.exit_codes import OutputFault, UsageFault
from mcserver.cli.output_file import check_output, write_atomically
from mcserver.simulation.recorder import Recorded
from mcserver.simulation.recording_file import write_csv, write_npz


@pytest.fixture
def run() -> Recorded:
    numbers = np.random.default_rng(7)
    return Recorded(
        time_s=np.arange(9000) / 1000.0,
        line=np.repeat([0.0, 4.0, 12.0], 3000),
        axes=np.array([0.0, 7.0]),
        setpoint=numbers.normal(scale=3000.0, size=(9000, 2)),
        actual=numbers.normal(scale=1e-7, size=(9000, 2)),
    )


def _csv(run: Recorded) -> bytes:
    stream = io.BytesIO()
    write_csv(run, stream)
    return stream.getvalue()


def test_the_header_names_time_line_and_each_axis_of_the_machine(run: Recorded) -> None:
    assert _csv(run).split(b"\n")[0] == b"time_s,line,setpoint_0,actual_0,setpoint_7,actual_7"


def test_tools_follow_the_axes_in_the_header(run: Recorded) -> None:
    tools = {3: np.zeros((9000, 6)), 12: np.ones((9000, 6))}
    head, first, *_ = _csv(replace(run, tools=tools)).decode().splitlines()
    columns = "tool_3_x,tool_3_y,tool_3_z,tool_3_a,tool_3_b,tool_3_c"
    assert head == (
        f"time_s,line,setpoint_0,actual_0,setpoint_7,actual_7,{columns},{columns.replace('_3_', '_12_')}"
    )
    assert first.split(",")[-12:] == ["0.0"] * 6 + ["1.0"] * 6


def test_npz_holds_an_array_for_each_tool(run: Recorded, tmp_path: Path) -> None:
    path = tmp_path / "t.npz"
    poses = np.arange(54000.0).reshape(9000, 6)
    write_atomically(str(path), lambda stream: write_npz(replace(run, tools={3: poses}), stream))
    with np.load(path) as arrays:
        assert arrays["tool_3"].dtype == np.float64
        assert np.array_equal(arrays["tool_3"], poses)


def test_every_number_reads_back_exactly(run: Recorded) -> None:
    table = np.loadtxt(io.BytesIO(_csv(run)), delimiter=",", skiprows=1)
    assert np.array_equal(table[:, 0], run.time_s)
    assert np.array_equal(table[:, 2::2], run.setpoint)
    assert np.array_equal(table[:, 3::2], run.actual)


def test_line_numbers_are_whole_and_each_cycle_has_one_row(run: Recorded) -> None:
    rows = _csv(run).decode().splitlines()[1:]
    assert len(rows) == 9000
    assert {row.split(",")[1] for row in rows} == {"0", "4", "12"}


def test_an_empty_recording_is_a_header_alone() -> None:
    nothing = np.empty((0, 1))
    assert (
        _csv(Recorded(np.empty(0), np.empty(0), np.zeros(1), nothing, nothing))
        == b"time_s,line,setpoint_0,actual_0\n"
    )


def test_npz_holds_float64_arrays_of_the_documented_shapes(run: Recorded, tmp_path: Path) -> None:
    path = tmp_path / "t.npz"
    write_atomically(str(path), lambda stream: write_npz(run, stream))
    with np.load(path) as arrays:
        assert set(arrays.files) == {"time_s", "line", "axes", "setpoint", "actual"}
        assert all(arrays[name].dtype == np.float64 for name in arrays.files)
        assert arrays["setpoint"].shape == (9000, 2)
        assert np.array_equal(arrays["axes"], [0.0, 7.0])


def test_a_write_that_fails_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("old")

    def fail(stream: io.BufferedIOBase) -> None:
        stream.write(b"half")
        raise OSError(28, "No space left on device")

    with pytest.raises(OutputFault, match=r"MC014.*No space left"):
        write_atomically(str(path), fail)
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["t.csv"]


def test_a_full_device_behind_a_link_is_a_coded_fault(tmp_path: Path, run: Recorded) -> None:
    link = tmp_path / "t.csv"
    link.symlink_to("/dev/full")
    with pytest.raises(OutputFault, match="MC014"):
        write_atomically(str(link), lambda stream: write_csv(run, stream))
    assert link.is_symlink()


def test_a_link_stays_a_link_and_its_target_keeps_its_permissions(tmp_path: Path) -> None:
    target, link = tmp_path / "real.csv", tmp_path / "t.csv"
    target.write_text("old")
    target.chmod(0o640)
    link.symlink_to(target)
    write_atomically(str(link), lambda stream: stream.write(b"new"))
    assert link.is_symlink()
    assert target.read_text() == "new"
    assert target.stat().st_mode & 0o777 == 0o640


def test_a_missing_folder_is_named_before_anything_is_computed(tmp_path: Path) -> None:
    with pytest.raises(UsageFault, match=r"MC013: there is no folder .*/nowhere"):
        check_output(str(tmp_path / "nowhere" / "t.csv"), (".csv", ".npz"))


@pytest.mark.parametrize("name", ["t", "t.txt", ".csv.gz"])
def test_an_unknown_suffix_lists_the_known_ones(tmp_path: Path, name: str) -> None:
    with pytest.raises(UsageFault, match=r"MC012.*\.csv or \.npz"):
        check_output(str(tmp_path / name), (".csv", ".npz"))


def test_a_folder_is_no_output(tmp_path: Path) -> None:
    (tmp_path / "t.csv").mkdir()
    with pytest.raises(UsageFault, match="MC013"):
        check_output(str(tmp_path / "t.csv"), (".csv", ".npz"))


def test_the_suffix_is_read_in_either_case(tmp_path: Path) -> None:
    assert check_output(str(tmp_path / "T.CSV"), (".csv", ".npz")) == ".csv"
