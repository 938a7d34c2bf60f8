"""What a program says to its operator is there when the program comes there (D-76)."""

from __future__ import annotations

from pathlib import Path

from mcserver.machine.machine_file import load_machine
from tests.service.virtual_cell import VirtualCell

MILL = load_machine(str(Path(__file__).parents[1] / "corpus" / "cnc.toml"))


async def test_messages_on_the_way_to_a_pause_are_its_notice(tmp_path: Path) -> None:
    cell = VirtualCell(MILL, tmp_path)
    try:
        service = cell.service
        program = await service.open("test")
        lines = ["T1 M6", "G0 X1", "(MSG, the drill of 3 mm)", "T2 M6", "G0 X2", "(MSG, done)"]
        service.lines.submit("test", program.program, 1, lines)
        service.lines.close("test", program.program)
        await cell.until(lambda: program.state == "paused")
        assert program.status().notice == "the drill of 3 mm · fit tool 2, then resume"
        service.resume(program.program)
        # what was to be done is no order any more
        assert program.status().notice == ""
        await cell.ended(program)
        assert program.state == "finished"
        said = [(each.kind, each.line, each.message) for each in cell.events if each.message]
        assert ("program.message", 4, "fit tool 2, then resume") in said
        assert ("program.paused", 4, "the drill of 3 mm · fit tool 2, then resume") in said
        assert ("program.message", 6, "done") in said
    finally:
        await cell.stop()
