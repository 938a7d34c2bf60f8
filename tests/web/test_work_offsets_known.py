"""Whether a machine's page has work coordinate systems."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import mcclient
import pytest

from mcserver.gcode.program_check import check_program
from mcserver.machine.machine_file import parse_machine
from mcserver.web.link import knows_work_offsets
from tests.machine_text import axes_text

SECOND = axes_text([7], keys="[axis.gantry]\nleader = 9\nmax_skew = 1.0")
CNC = '[dialect]\nprofile = "cnc"\nrapids = "straight"\n'


@pytest.mark.parametrize(
    ("dialect", "axes", "known"),
    [
        (CNC, axes_text([0, 1]), True),
        # no axis has a letter, and the first one is led by another
        (CNC, SECOND + axes_text([9]), True),
        ("", axes_text([9, 12]), False),
    ],
)
async def test_a_page_shows_work_offsets_where_the_dialect_has_them(
    dialect: str, axes: str, known: bool
) -> None:
    machine = parse_machine(f'[machine]\nname = "cell"\n{dialect}{axes}')

    async def check(text: str) -> Any:
        found = check_program(text, machine)
        return SimpleNamespace(ok=not any(each.severity == "error" for each in found), diagnostics=found)

    link = SimpleNamespace(name="cell", info=SimpleNamespace(axes=machine.axes), check=check)
    assert await knows_work_offsets(cast("mcclient.Machine", link)) is known
