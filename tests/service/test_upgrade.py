"""A start on the files of an older version, as its own code has written them before it was killed.

`tests/service/journals` has the journal: a program that has finished, one with a fault, one under way. No
version was released yet; it is the one before the journal's format changed.
"""

from __future__ import annotations

import zipfile
from pathlib import Path

from mcserver.machine.machine_file import Machine, load_machine, parse_machine
from mcserver.service.journal_reader import read_lines_before
from tests.machine_text import axes_text
from tests.service.virtual_cell import VirtualCell

JOURNALS = Path(__file__).parent / "journals"


def machine_of_then(folder: Path) -> Machine:
    file = folder / "machine.toml"
    if file.exists():
        return load_machine(str(file))
    return parse_machine(f'[machine]\nname = "cell"\n{axes_text(range(3))}')


async def test_a_server_starts_on_journal_and_machine_file_of_an_older_version_and_knows_its_programs(
    tmp_path: Path,
) -> None:
    with zipfile.ZipFile(JOURNALS / "version-3.zip") as archive:
        archive.extractall(tmp_path)
    cell = VirtualCell(machine_of_then(tmp_path), tmp_path, instance="now")
    try:
        assert cell.service._table.journal_damage is None
        new = await cell.run("G1010 P0", "G04 P0.01", axes=[0])
        known = await cell.service.known(program_id=None, ended=True, limit=10)
        assert [(each.program, each.state, each.accepted, each.done) for each in known] == [
            (new.program, "finished", 2, 2),
            ("second-1", "interrupted", 40, 10),
            ("first-2", "faulted", 2, 1),
            ("first-1", "finished", 6, 6),
        ]
        assert known[2].fault is not None
        assert known[2].fault.code == "MC410"
        journal = cell.service.options.journal
        assert read_lines_before(journal, "second-1", 12) == [f"G01 X{number}" for number in range(1, 12)]
        assert read_lines_before(journal, "first-1", 7)[-1] == "(é) G01 X0 Y0"
    finally:
        await cell.stop()
