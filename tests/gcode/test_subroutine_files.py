"""Subprograms in files of the machine's folder (D-83, D-91)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from mcserver.errors import ConfigurationError
from mcserver.gcode.program_check import check_program
from mcserver.machine import subroutines
from mcserver.machine.machine_digest import machine_digest
from mcserver.machine.machine_file import Machine, load_machine, parse_machine
from mcserver.planning.start_state import StartState
from mcserver.planning.state_before import state_before
from tests.bench.rs274_programs import moves_here
from tests.gcode.macro_programs import MACHINE_TEXT

DRILL = "(a hole)\no<drill> sub\nG1 X#1\no1 if [#2 GT 5]\n  G1 Y#2\no1 endif\no<drill> endsub\nM2\n"


@pytest.fixture
def load(tmp_path: Path) -> Callable[..., Machine]:
    def made(macros: str = "linuxcnc", **files: str) -> Machine:
        (tmp_path / "subs").mkdir(exist_ok=True)
        for name, text in files.items():
            (tmp_path / "subs" / name.replace("__", ".")).write_text(text)
        text = MACHINE_TEXT.replace('"fanuc"', f'"{macros}"\nsubroutines = "subs"')
        (tmp_path / "mill.toml").write_text(text)
        return load_machine(str(tmp_path / "mill.toml"))

    return made


def test_a_file_is_called_by_its_name(load: Callable[..., Machine]) -> None:
    machine = load(drill__ngc=DRILL, O0100__nc="o100 sub\nG1 X9\no100 endsub")
    moves, fault = moves_here("F100\no<Drill> call [3] [6]\no[99 + 1] call", machine)
    assert (moves, fault) == ([(3, 0, 0), (3, 6, 0), (9, 6, 0)], "")
    # one in the text goes first
    moves, fault = moves_here("F100\no<drill> sub\nG1 X5\no<drill> endsub\no<drill> call [3] [6]", machine)
    assert (moves, fault) == ([(5, 0, 0)], "")


def test_programs_of_fanucs_are_called_by_their_number(load: Callable[..., Machine]) -> None:
    machine = load("fanuc", o0100__nc="%\nO0100 (HOLE)\nG1 X#1 Y#2\nM99\n%")
    text = "F100\nG65 P100 A3\nG1 Y1\nM30"
    assert moves_here(text, machine) == ([(3, 0, 0), (3, 1, 0)], "")
    assert state_before(text.splitlines(), 3, machine, StartState.of(machine)).positions[0] == 0.003
    # one number for one program
    (fault,) = check_program("F100\nM98 P7\nM30\nO100\nM99\nO7\nM99", machine)
    assert (fault.code, fault.line) == ("MC181", 4)


@pytest.mark.parametrize(
    ("macros", "content", "code", "words"),
    [
        ("linuxcnc", "o<bad> sub\nG1 X[1+\no<bad> endsub", "MC160", "line 2"),
        ("linuxcnc", "o<bad> sub\nG1 X[1/0]\no<bad> endsub", "MC163", "line 2"),
        ("linuxcnc", "o<bad> sub\n\nG1 Q7 X1\no<bad> endsub", "MC113", "line 3"),
        ("linuxcnc", "o<bad> sub\no1 while [1]\no1 endwhile\no<bad> endsub", "MC164", "line 2"),
        ("linuxcnc", "o<bad> sub", "MC161", "not closed"),
        ("linuxcnc", "G1 X1", "MC161", "outside"),
        ("linuxcnc", "", "MC161", "there is no o<bad> sub"),
        ("linuxcnc", "o<other> sub\no<other> endsub", "MC161", "outside"),
        ("fanuc", "O7\nG1 X[1/0]\nM99", "MC163", "line 2"),
        ("fanuc", "O7\n\nG1 Q7 X1\nM99", "MC113", "line 3"),
        # its line has the number of the line that calls it
        ("fanuc", "O7\nG1 X1 F-3\nM99", "MC120", "line 2: F-3"),
        ("fanuc", "O7\nEND1\nM99", "MC181", "line 2"),
        ("fanuc", "O8\nM99", "MC181", "O8 is another program"),
        ("fanuc", "O7\nG1 X1", "MC182", "no M99"),
    ],
)
def test_a_fault_in_a_file_is_said_at_the_call(
    load: Callable[..., Machine],
    monkeypatch: pytest.MonkeyPatch,
    macros: str,
    content: str,
    code: str,
    words: str,
) -> None:
    monkeypatch.setattr("mcserver.gcode.computing.expansion.MOST_STEPS", 500)
    machine = load(macros, **({"bad__ngc": content} if macros == "linuxcnc" else {"7__nc": content}))
    call = "o<bad> call" if macros == "linuxcnc" else "M98 P7"
    found = check_program(f"G1 F100 Z1\n{call}\nG1 Z2\nM30", machine)
    assert [(each.code, each.line) for each in found if each.severity == "error"][:1] == [(code, 2)]
    assert words in found[0].message


def test_what_an_approval_rests_on_has_the_texts(load: Callable[..., Machine]) -> None:
    before = machine_digest(load(drill__ngc=DRILL))
    assert machine_digest(load(drill__ngc=DRILL)) == before
    assert machine_digest(load(drill__ngc=DRILL.replace("X#1", "X#2"))) != before


@pytest.mark.parametrize("folder", ["../subs", "/tmp", "subs/../..", "none", "", "."])
def test_only_a_folder_beside_the_machine_file_is_read(
    load: Callable[..., Machine], tmp_path: Path, folder: str
) -> None:
    load(drill__ngc=DRILL)
    text = (tmp_path / "mill.toml").read_text().replace('"subs"', f'"{folder}"')
    if not folder:
        assert not parse_machine(text, folder=tmp_path).dialect.subroutines
        return
    with pytest.raises(ConfigurationError, match="subroutines"):
        parse_machine(text, folder=tmp_path)


def test_comments_in_latin_1_are_read_and_what_is_no_text_is_named(
    load: Callable[..., Machine], tmp_path: Path
) -> None:
    load(drill__ngc=DRILL)
    file = tmp_path / "subs" / "drill.ngc"
    file.write_bytes(f"(Werkst\u00fcck)\n{DRILL}".encode("latin-1"))
    assert load().dialect.subroutines["drill"].startswith("(Werkst\u00fcck)")
    file.write_bytes(b"\xff\0")
    with pytest.raises(ConfigurationError, match=r"drill\.ngc is no text") as refused:
        load()
    assert "codec" not in str(refused.value)


def test_files_that_cannot_be_called_or_are_too_many_are_refused(
    load: Callable[..., Machine], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    load(drill__ngc=DRILL)
    (tmp_path / "subs" / "link.ngc").symlink_to(tmp_path / "mill.toml")
    with pytest.raises(ConfigurationError, match=r"link\.ngc' cannot be called"):
        load()
    (tmp_path / "subs" / "link.ngc").unlink()
    with pytest.raises(ConfigurationError, match="cannot be called"):
        load(DRILL__nc=DRILL)
    (tmp_path / "subs" / "DRILL.nc").unlink()
    monkeypatch.setattr(subroutines, "MOST_BYTES", 10)
    with pytest.raises(ConfigurationError, match="more than"):
        load()
