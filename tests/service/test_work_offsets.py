"""Work coordinate systems outlive programs and the server."""

from __future__ import annotations

from pathlib import Path

import pytest

from mcserver.errors import ServiceError
from mcserver.gcode.profiles.frame import Frame
from mcserver.gcode.program_check import check_program
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.machine.machine_file import load_machine
from mcserver.motion.canonical import MotionLine, RapidGroup
from mcserver.planning.start_state import StartState
from mcserver.planning.state_before import state_before
from mcserver.service.work_offsets import WorkOffsets
from mcserver.simulation.program_checker import check_text
from mcserver.simulation.simulation import simulate

MILL = load_machine(str(Path(__file__).parents[1] / "corpus" / "cnc.toml"))


def target(interpreter: Interpreter, text: str) -> tuple[float, ...]:
    (line,) = interpreter.interpret_text(text, 1)
    assert isinstance(line, MotionLine)
    (group,) = line.groups
    assert isinstance(group, RapidGroup)
    return group.targets


def test_systems_are_there_again_after_a_restart(tmp_path: Path) -> None:
    path = tmp_path / "journal.db.offsets.json"
    assert WorkOffsets(path).frame() is None
    WorkOffsets(path).keep(Frame(systems={1: {0: 0.1, 6: -0.25}, 3: {2: 1e-3}}))
    again = WorkOffsets(path)
    assert (again.systems, again.failure) == ({1: {0: 0.1, 6: -0.25}, 3: {2: 1e-3}}, "")
    assert again.frame() == Frame(systems=again.systems)


@pytest.mark.parametrize("content", [b"", b"{", b'{"1": {"0": "far"}}', b"\xff\xfe", b"[]", b'{"1":' * 3000])
def test_with_a_damaged_file_the_server_does_not_start(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "offsets.json"
    path.write_bytes(content)
    with pytest.raises(ServiceError, match="MC529") as refused:
        WorkOffsets(path)
    assert "mcctl zero" in refused.value.hint
    assert path.read_bytes() == content


def test_a_file_that_cannot_be_written_leaves_the_systems_in_memory(tmp_path: Path) -> None:
    offsets = WorkOffsets(tmp_path / "missing" / "offsets.json")
    offsets.keep(Frame(systems={1: {0: 0.1}}))
    assert "could not be kept" in offsets.failure
    assert offsets.systems == {1: {0: 0.1}}


def test_a_program_starts_in_the_systems_that_are_kept() -> None:
    frame = Frame(systems={1: {0: 0.1}, 2: {0: 0.2}})
    assert target(Interpreter(MILL, frame=frame), "G0 X10") == pytest.approx((0.11,))
    assert target(Interpreter(MILL, frame=frame), "G55 G0 X10") == pytest.approx((0.21,))


def test_the_reference_s_dialect_knows_no_systems() -> None:
    interpreter = Interpreter(load_machine("cartesian"), frame=Frame(systems={1: {0: 0.1}}))
    assert target(interpreter, "G00 X10") == pytest.approx((0.01,))


def test_a_program_that_goes_on_in_its_middle_has_the_systems_that_it_began_with() -> None:
    frame = Frame(systems={1: {0: 0.1}})
    lines = ["G55", "G0 X1", "G10 L2 P3 Y5", "G54"]
    modal = state_before(lines, 5, MILL, StartState.of(MILL, frame)).modal
    assert target(Interpreter(MILL, modal=modal), "G0 X10") == pytest.approx((0.11,))


def test_what_a_program_set_is_known_behind_its_end_and_g92_ends_with_it() -> None:
    interpreter = Interpreter(MILL)
    for number, text in enumerate(("G0 X30", "G10 L20 P0 X5", "G92 Y7", "M30"), start=1):
        interpreter.interpret_text(text, number)
    assert interpreter.frame is not None
    assert interpreter.frame.systems[1][0] == pytest.approx(0.025)
    assert interpreter.modal.frame is None


def test_a_check_and_a_simulation_begin_in_the_systems_that_are_kept() -> None:
    shifted = StartState.of(MILL, Frame(systems={1: {0: 0.45}}))
    assert [each.code for each in check_text("G0 X60", MILL, shifted)] == ["MC201"]
    assert check_program("G0 X60", MILL) == []
    assert simulate("G0 X60", MILL, start=shifted).report["diagnostics"][0]["code"] == "MC201"
    assert simulate("G0 X10", MILL, start=shifted).report["axes"]["0"]["position"] == pytest.approx(460.0)
