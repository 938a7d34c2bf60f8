"""For how long a tool has cut is counted, kept, and looked at where it is fitted."""

from __future__ import annotations

from pathlib import Path

import pytest

from mcserver.errors import Refused, ServiceError
from mcserver.gcode.profiles.frame import Frame
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.machine.dialect_section import Cutter
from mcserver.machine.machine_file import load_machine
from mcserver.motion.canonical import PauseLine
from mcserver.planning.planner_messages import Report, ReportKind
from mcserver.planning.start_state import frame_changes
from mcserver.service.tool_use import ToolUse
from mcserver.service.work_offsets import RowNote, WorkOffsets

MILL = load_machine(str(Path(__file__).parents[1] / "corpus" / "cnc.toml"))
TABLE = {3: Cutter(0.04, 0.006)}


def feed(line: int) -> Report:
    return Report(ReportKind.PLANNED, line, requested_s=1.0, feed_length=0.1)


def test_a_tool_cuts_in_feed_moves_while_its_spindle_turns_and_nothing_holds_it() -> None:
    use = ToolUse()
    use.planned([feed(2), feed(4), feed(5), feed(5), feed(6)])
    use.behind(1, Frame(changed=3))
    assert use.ended(2, 0.0, 1.0) == (0, 1.0)
    use.behind(3, Frame(changed=3, direction=1))
    # a rapid
    assert use.ended(3, 1.0, 2.0) == (0, 1.0)
    # the next one begins before it is at its end
    assert use.ended(4, 2.0, 4.0) == (3, 2.0)
    use.held(5.0)
    use.held(5.5)
    use.released(8.0)
    assert use.ended(5, 3.5, 9.0) == (3, 2.0)
    # the same line again, in a loop; the spindle of the next one stands still
    use.behind(6, Frame(changed=3))
    assert use.ended(5, 9.0, 10.0) == (3, 1.0)
    assert use.ended(6, 10.0, 12.0) == (0, 2.0)


def test_life_and_use_outlive_the_server_and_a_used_up_tool_is_not_gone_on_with(tmp_path: Path) -> None:
    path = tmp_path / "offsets.json"
    tables = WorkOffsets(path, TABLE)
    tables.annotate("T3", name=" end mill ", life_s=120.0, wall=5.0, client="mcctl", by="ada")
    assert [tables.cut(3, 60.0), tables.cut(3, 59.0), tables.cut(7, 1e6)] == [False, False, False]
    assert (tables.frame(), tables.worn_text(3)) == (Frame(), "")
    tables.refuse_worn(3)
    assert [tables.cut(3, 1.0), tables.cut(3, 1.0)] == [True, False]
    tables.save_use()
    again = WorkOffsets(path, TABLE)
    assert again.notes == {"T3": RowNote("end mill", 120.0, 121.0)}
    assert again.frame() == Frame(worn=frozenset({3}))
    with pytest.raises(Refused, match=r"tool 3 has cut 2\.017 of its 2 min"):
        again.refuse_worn(3)
    (named,) = again.changes
    assert (named.row, named.name, named.after, named.called) == ("T3", "ada", {"life": 120.0}, "end mill")
    assert again.annotate("T3", used_s=0.0) is not None
    assert again.annotate("T3", used_s=0.0) is None
    again.refuse_worn(3)
    # what was measured meanwhile is a change of its own
    again.keep(Frame(cutters={3: Cutter(0.05, 0.006)}), program="p-1")
    assert [each.after for each in again.changes[1:]] == [{"used": 0.0}, {"length": 0.05, "diameter": 0.006}]


@pytest.mark.parametrize(
    ("row", "more"),
    [
        ("T4", {}),
        ("T03", {}),
        ("G60", {}),
        ("", {}),
        ("T³", {}),
        ("G54", {"life_s": 60.0}),
        ("G54", {"used_s": 1.0}),
    ],
)
def test_rows_that_are_not_there_and_lives_of_offsets_are_refused(
    tmp_path: Path, row: str, more: dict[str, float]
) -> None:
    tables = WorkOffsets(tmp_path / "offsets.json", TABLE)
    with pytest.raises(ServiceError, match="MC601"):
        tables.annotate(row, name="vise", **more)
    assert not tables.changes


def test_the_first_tool_is_asked_for_where_it_is_used_up() -> None:
    (number, *_) = sorted(MILL.dialect.cutters)
    worn = Frame(worn=frozenset({number}))
    asked = {}
    for frame in (Frame(), worn):
        values = Interpreter(MILL, frame=frame).interpret_text(f"T{number} M6", 1)
        asked[frame.worn] = [each.tool for each in values if isinstance(each, PauseLine)]
    assert asked == {frozenset(): [], worn.worn: [number]}
    assert frame_changes(MILL, Frame(), worn) == []
