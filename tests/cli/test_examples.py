"""`mcserver examples`: the programs that come with the package."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from mcserver.cli.app import run_command_line
from tests.cli.command import EXAMPLES

Capture = pytest.CaptureFixture[str]


def test_every_example_is_listed_with_its_title(capfd: Capture) -> None:
    assert run_command_line(["examples"]) == 0
    shown = capfd.readouterr().out.splitlines()
    assert [line.split()[0] for line in shown] == sorted(file.stem for file in EXAMPLES.glob("*.gcode"))
    assert all(len(line.split()) > 3 for line in shown)


@pytest.mark.parametrize("name", ["square", "square.gcode"])
def test_one_example_is_printed_as_it_is(name: str, capfd: Capture) -> None:
    assert run_command_line(["examples", name]) == 0
    assert capfd.readouterr().out == (EXAMPLES / "square.gcode").read_text("utf-8")


def test_all_are_written_into_a_folder_that_is_made(tmp_path: Path, capfd: Capture) -> None:
    folder = tmp_path / "new" / "folder"
    assert run_command_line(["examples", "--output", str(folder), "--json"]) == 0
    answer = json.loads(capfd.readouterr().out)
    assert {each["file"] for each in answer["examples"].values()} == {str(file) for file in folder.iterdir()}
    assert (folder / "arcs.gcode").read_bytes() == (EXAMPLES / "arcs.gcode").read_bytes()


def test_an_unknown_name_lists_those_there_are(capfd: Capture) -> None:
    assert run_command_line(["examples", "../secret"]) == 2
    assert (
        "arcs, clearance, coordination, five-axis, helix, mill-part, robot-dog, square"
        in capfd.readouterr().err
    )


def test_a_folder_that_cannot_be_made_is_a_coded_error(tmp_path: Path, capfd: Capture) -> None:
    (tmp_path / "file").touch()
    assert run_command_line(["examples", "-o", str(tmp_path / "file" / "folder")]) == 1
    assert "error[MC" in capfd.readouterr().err
