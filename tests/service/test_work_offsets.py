"""Work coordinate systems and the tool table outlive programs and the server."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from mcserver.errors import ConfigurationError, ServiceError
from mcserver.gcode.profiles.frame import Frame
from mcserver.gcode.program_check import check_program
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.machine.dialect_section import Cutter
from mcserver.machine.machine_file import load_machine, parse_machine
from mcserver.motion.canonical import MotionLine, RapidGroup
from mcserver.planning.start_state import StartState, frame_changes
from mcserver.planning.state_before import state_before
from mcserver.service.work_offsets import WorkOffsets
from mcserver.simulation.foresight import check_text
from mcserver.simulation.simulation import simulate
from tests.machine_text import axes_text

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


def after(*lines: str, frame: Frame | None = None) -> Frame:
    interpreter = Interpreter(MILL, frame=frame)
    for number, text in enumerate(lines, start=1):
        interpreter.interpret_text(text, number)
    assert interpreter.frame is not None
    return interpreter.frame


def test_g10_l1_sets_length_and_radius_of_a_tool_and_g43_takes_it() -> None:
    frame = after("G10 L1 P3 Z75.2 R3", "G20 G10 L1 P7 Z1", "G10 L1 P7 R.5", "M30")
    assert frame.cutters[3] == Cutter(pytest.approx(0.0752), pytest.approx(0.006))
    assert frame.cutters[7] == Cutter(pytest.approx(0.0254), pytest.approx(0.0254))
    assert target(Interpreter(MILL, frame=frame), "G43 H3 G0 Z10") == pytest.approx((0.0852,))
    assert target(Interpreter(MILL, frame=frame), "G43 H1 G0 Z10") == pytest.approx((0.030,))


def test_g10_l1_leaves_what_it_does_not_name_as_the_machine_file_has_it() -> None:
    assert after("G10 L1 P2 R4").cutters == {2: Cutter(pytest.approx(0.0355), pytest.approx(0.008))}


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("G10 L1 Z5", "MC143"),
        ("G10 L1 P0 Z5", "MC143"),
        ("G10 L1 P1.5 Z5", "MC143"),
        ("G10 L1 P9 R5", "MC143"),
        ("G10 L1 P1", "MC118"),
        ("G10 L1 P1 X5 Z5", "MC118"),
        ("G10 L1 P1 Z5 R-1", "MC116"),
        ("G10 L3 P1 Z5", "MC141"),
    ],
)
def test_a_wrong_g10_l1_is_refused(line: str, code: str) -> None:
    assert [each.code for each in check_program(line, MILL)] == [code]


def test_who_changed_a_row_when_and_from_what_is_kept_over_a_restart(tmp_path: Path) -> None:
    path, cutters = tmp_path / "offsets.json", {3: Cutter(0.01)}
    kept = WorkOffsets(path, cutters)
    kept.keep(Frame(systems={1: {0: 0.1}}), wall=1.0, client="hmi", program="p1", name="zero")
    kept.keep(Frame(systems={1: {0: 0.2}}), wall=2.0, client="hmi", program="p1", name="zero")
    kept.keep(
        Frame(systems={1: {0: 0.2}}, cutters={3: Cutter(0.02, 0.006)}), wall=3.0, client="cam", program="p2"
    )
    again = WorkOffsets(path, cutters)
    assert [(each.wall, each.client, each.row, each.before, each.after) for each in again.changes] == [
        (2.0, "hmi", "G54", {}, {"0": 0.2}),
        (3.0, "cam", "T3", {"length": 0.01, "diameter": 0.0}, {"length": 0.02, "diameter": 0.006}),
    ]
    assert again.frame() == kept.frame()
    assert again.is_changed(3)


def test_a_tool_counts_as_set_until_the_machine_file_says_otherwise(tmp_path: Path) -> None:
    path = tmp_path / "offsets.json"
    WorkOffsets(path, {3: Cutter(0.01)}).keep(Frame(cutters={3: Cutter(0.02), 4: Cutter(0.03)}))
    edited = WorkOffsets(path, {3: Cutter(0.015)})
    assert edited.cutters == {3: Cutter(0.015), 4: Cutter(0.03)}


def test_changes_are_bounded(tmp_path: Path) -> None:
    kept = WorkOffsets(tmp_path / "offsets.json")
    for number in range(120):
        kept.keep(Frame(systems={1: {0: float(number + 1)}}), program=f"p{number}")
    assert len(kept.changes) == 100
    assert kept.changes[-1].after == {"0": 120.0}


def test_an_approval_names_a_tool_that_is_another_one() -> None:
    before, now = (StartState.of(MILL, Frame(cutters={1: Cutter(length)})) for length in (0.02, 0.025))
    assert frame_changes(MILL, None, before.frame) == []
    assert frame_changes(MILL, before.frame, now.frame) == [("T1", "length", "5 mm")]


def test_of_programs_side_by_side_each_changes_what_it_has_set_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "offsets.json"
    offsets = WorkOffsets(path)
    begun = Frame(systems={1: {0: 0.1, 1: 0.2}}, cutters={3: Cutter(0.05, 0.006)})
    offsets.keep(begun)
    one, other = (
        Frame(systems={1: {0: 0.7, 1: 0.2}}, cutters={3: Cutter(0.08, 0.006)}),
        Frame(systems={1: {0: 0.1, 1: 0.9}, 2: {0: 0.3}}, cutters={3: Cutter(0.05, 0.01)}),
    )
    offsets.keep(one, before=begun)
    offsets.keep(other, before=begun)
    # what one sets again counts from what it has set, whatever others did meanwhile
    offsets.keep(Frame(systems={1: {0: 0.6, 1: 0.2}}, cutters=one.cutters), before=one)
    again = WorkOffsets(path)
    assert again.systems == {1: {0: 0.6, 1: 0.9}, 2: {0: 0.3}}
    assert again.cutters == {3: Cutter(0.08, 0.01)}


def test_parameters_stay_for_the_next_program_and_over_a_restart(tmp_path: Path) -> None:
    text = 'profile = "cnc"\npersistent = [[100, 120]]'
    mill = parse_machine(f'[machine]\nname = "mill"\n{axes_text([0])}[dialect]\n{text}\n')
    path = tmp_path / "offsets.json"
    first = simulate("#100 = 5\n#121 = 7\nG1 X#100 F1000\n#101 = [#100 + 1]\n", mill).end
    assert first is not None
    assert first.frame is not None
    WorkOffsets(path).keep(first.frame, before=Frame())
    kept = WorkOffsets(path).frame()
    assert kept == Frame(parameters={100: 5.0, 101: 6.0})
    then = simulate("G1 X[#101 * 2 + #121] F1000", mill, start=StartState.of(mill, kept))
    assert then.report["axes"]["0"]["position"] == pytest.approx(12.0)


def test_macro_b_keeps_its_common_variables_until_they_are_cleared(tmp_path: Path) -> None:
    text = 'profile = "cnc"\nmacros = "fanuc"'
    mill = parse_machine(f'[machine]\nname = "mill"\n{axes_text([0])}[dialect]\n{text}\n')
    offsets = WorkOffsets(tmp_path / "offsets.json")
    offsets.keep(Frame(parameters={500: 4.0, 501: 9.0, 502: 1.0}))
    begun = offsets.frame()
    found = simulate(
        "#500 = #0\n#501 = [#501 + 1]\n#100 = 3\nM30", mill, start=StartState.of(mill, begun)
    ).end
    assert found is not None
    assert found.frame is not None
    # another program has set its own meanwhile
    offsets.keep(Frame(parameters={502: 2.0}), before=Frame(parameters={502: 1.0}))
    offsets.keep(found.frame, before=begun)
    assert WorkOffsets(tmp_path / "offsets.json").parameters == {501: 10.0, 502: 2.0}


@pytest.mark.parametrize("given", ["[[1, 20]]", "[[40, 31]]", "[[5000, 5001]]"])
def test_parameters_that_cannot_stay_are_refused(given: str) -> None:
    with pytest.raises(ConfigurationError, match="MC004"):
        parse_machine(
            f'[machine]\nname = "mill"\n{axes_text([0])}[dialect]\nprofile = "cnc"\npersistent = {given}\n'
        )


def test_no_flipped_bit_of_the_tables_is_taken_for_another_offset(tmp_path: Path) -> None:
    path = tmp_path / "offsets.json"
    WorkOffsets(path).keep(Frame(systems={1: {0: 0.125}}, cutters={3: Cutter(0.08, 0.01)}))
    for file in (path, path.with_name("offsets.json.tables.json")):
        # in place: to write it anew costs a hundred times as much
        with file.open("r+b", buffering=0) as opened:
            for place, sound in enumerate(file.read_bytes()):
                for bit in range(8):
                    os.pwrite(opened.fileno(), bytes([sound ^ 1 << bit]), place)
                    with pytest.raises(ServiceError, match="MC529"):
                        WorkOffsets(path)
                os.pwrite(opened.fileno(), bytes([sound]), place)


def test_tables_of_before_they_had_a_checksum_are_read(tmp_path: Path) -> None:
    (tmp_path / "offsets.json").write_bytes(b'{"1":{"0":0.125}}')
    assert WorkOffsets(tmp_path / "offsets.json").systems == {1: {0: 0.125}}
