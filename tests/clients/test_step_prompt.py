"""``mcctl drives step`` asks before it moves: only the axis's own number arms it."""

from __future__ import annotations

import io
import sys

import pytest
from fake_server import FakeServer
from mcclient.cli.app import run_command_line


class Terminal(io.StringIO):
    """Somebody who types this."""

    def isatty(self) -> bool:
        return True


def step(
    server: FakeServer,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    typed: io.StringIO,
) -> tuple[int, str]:
    """Exit code and standard error of a step of axis 1."""
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.setattr(sys, "stdin", typed)
    code = run_command_line(["drives", "step", "1", "--distance", "2", "--connect", server.endpoint])
    shown = capsys.readouterr()
    return code, shown.err + shown.out


@pytest.mark.parametrize("answer", ["\n", "y\n", "0\n", "11\n"])
def test_another_answer_than_the_number_of_the_axis_leaves_it_still(
    server: FakeServer, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], answer: str
) -> None:
    code, shown = step(server, monkeypatch, capsys, Terminal(answer))
    assert code != 0
    assert "axis 1 moves by 2" in shown
    assert "the step was not armed" in shown
    assert server.programs == {}
    assert server.executed == []


def test_without_a_terminal_nothing_moves_and_the_option_is_named(
    server: FakeServer, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code, shown = step(server, monkeypatch, capsys, io.StringIO("1\n"))
    assert code != 0
    assert "--armed" in shown
    assert server.programs == {}


def test_the_number_of_the_axis_arms_it(
    server: FakeServer, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    step(server, monkeypatch, capsys, Terminal("1\n"))
    assert [text for _, _, text in server.executed if "G00" in text] == [
        "G91 G00 [1]2.000000",
        "G91 G00 [1]-2.000000",
    ]
