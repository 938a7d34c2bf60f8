"""Words of others come to a terminal, and into a log, as text: nothing in them is obeyed."""

from __future__ import annotations

import io
import json
import logging
import sys
import unicodedata
from collections.abc import Callable

import mcclient.cli.output as mcctl_output
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcclient.cli.app import run_command_line as run_mcctl
from rich.console import Group
from rich.table import Table
from rich.text import Text

import mcserver.cli.console as mcserver_console
from mcserver import terminal as mcserver
from mcserver.cli.app import run_command_line as run_mcserver
from mcserver.cli.console import NarrationHandler
from mcserver.cli.terminal_console import TerminalConsole

ATTACK = "job\x1b[2J\x1b]0;ready\x07\r\nfinished\u202egnp\x9b31m\u2028[bold]x[/bold] :smiley:\x7f\ud800"
OBEYED = ("Cc", "Cf", "Cs", "Zl", "Zp")


def obeyed(text: str) -> list[str]:
    return [each for each in text if each != "\n" and unicodedata.category(each) in OBEYED]


def test_what_a_terminal_would_obey_is_shown_by_its_number() -> None:
    assert mcserver.visible("a\x1b[2J\n\r\x9b\u202e\tä 宽") == "a\\x1b[2J\\n\\r\\x9b<U+202E>\tä 宽"


@given(st.text())
def test_every_text_is_shown_printably(text: str) -> None:
    assert obeyed(mcserver.visible(text).replace("\t", "")) == []
    said = mcserver.visible_json(json.dumps([text], ensure_ascii=False))
    assert json.loads(said) == [text]
    assert obeyed(said) == []


@pytest.mark.parametrize("terminal", [False, True])
def test_whatever_is_printed_makes_one_line_of_its_own(terminal: bool) -> None:
    table = Table(ATTACK, box=None, title=ATTACK)
    table.add_row(ATTACK)
    table.add_row(Text(ATTACK))
    for lines, printed in [(1, ATTACK), (1, Text(ATTACK)), (2, Group(ATTACK, Text(ATTACK))), (4, table)]:
        to = io.StringIO()
        console = TerminalConsole(
            file=to, width=400, force_terminal=terminal, color_system=None, legacy_windows=False
        )
        console.print(printed)
        assert obeyed(to.getvalue()) == []
        assert to.getvalue().count("\n") == lines
        assert "[bold]x[/bold] :smiley:" in to.getvalue()


@pytest.mark.parametrize("run", [run_mcserver, run_mcctl])
@pytest.mark.parametrize(
    "words",
    [[ATTACK], ["check", "a", ATTACK], ["doctor", ATTACK], ["status", ATTACK], ["status", f"--{ATTACK}"]],
)
def test_words_that_a_command_does_not_take_are_shown_as_text(
    run: Callable[[list[str]], int], words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(words) == 2
    said = capsys.readouterr()
    assert obeyed(said.out + said.err) == []


def test_styles_stay_on_their_words() -> None:
    to = io.StringIO()
    console = TerminalConsole(file=to, width=80, force_terminal=True, color_system="standard", no_color=False)
    console.print(Text.assemble(("a\n", "bold"), "b\x1bc", ("d", "bold")))
    assert to.getvalue() == "\x1b[1ma\\n\x1b[0mb\\x1bc\x1b[1md\x1b[0m\n"


def test_a_text_for_a_file_is_exact_and_for_a_terminal_visible(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for module in (mcctl_output, mcserver_console):
        module.write_text("a\x1b[2J\nb\n")
        assert capsys.readouterr().out == "a\x1b[2J\nb\n"
        with monkeypatch.context() as patched:
            patched.setattr(sys.stdout, "isatty", lambda: True)
            module.write_text("a\x1b[2J\nb\n")
        assert capsys.readouterr().out == "a\\x1b[2J\nb\n"


def record(message: str, error: Exception | None = None) -> logging.LogRecord:
    info = None if error is None else (type(error), error, None)
    return logging.LogRecord("name", logging.WARNING, __file__, 1, "%s", (message,), info)


def test_a_record_of_the_log_is_one_line() -> None:
    said = mcserver.LogFormatter().format(record(ATTACK))
    assert obeyed(said) == []
    assert "\n" not in said


def test_a_traceback_in_the_log_is_indented_so_that_no_words_begin_a_line(
    capsys: pytest.CaptureFixture[str],
) -> None:
    NarrationHandler().handle(record("it failed", ValueError(f"\n{ATTACK}")))
    said = capsys.readouterr().err
    assert obeyed(said) == []
    first, *rest = said.splitlines()
    assert first.endswith("WARNING  it failed")
    assert rest
    assert all(line.startswith("  ") for line in rest)
