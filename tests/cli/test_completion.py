"""Shell completion of commands, machines and files."""

from __future__ import annotations

import pytest

from mcserver.cli.app import run_command_line
from tests.cli.command import ROOT


@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        ("mcserver sim", ["simulate"]),
        ("mcserver check --machine ro", ["robot-dog"]),
        ("mcserver check examples/ar", ["examples/arcs.gcode"]),
        ("mcserver check no-such-folder/a", []),
    ],
)
def test_what_is_typed_is_completed(
    typed: str, offered: list[str], monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("_MCSERVER_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", typed)
    monkeypatch.setenv("COMP_CWORD", str(len(typed.split()) - 1))
    monkeypatch.chdir(ROOT)
    run_command_line([])
    shown = capfd.readouterr()
    assert (shown.out.split(), shown.err) == (offered, "")
