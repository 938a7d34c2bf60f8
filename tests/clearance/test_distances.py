"""A contact never reads as the margin itself, wherever it is said."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mcserver.clearance.distances import contact_mm, too_near
from mcserver.machine.machine_file import parse_machine
from mcserver.simulation.lost_drives import Lost
from mcserver.simulation.simulation import simulate
from mcserver.units import MM
from tests.clearance.cells import Start, place
from tests.clearance.machines import MILL, TOOL, VISE, block, mill
from tests.clearance.stopping import judged

MARGIN = "[clearance]\nmargin_mm = 5.0"


def said(diagnostic: Any) -> tuple[float, float]:
    """The distance and the margin of a diagnostic's message [mm]."""
    message = diagnostic["message"] if isinstance(diagnostic, dict) else diagnostic.message
    distance, margin = message.partition(" mm, ")[0].split()[-1], message.partition(" mm, ")[2].split()[0]
    return float(distance), float(margin)


@given(st.integers(1, 100_000), st.floats(1e-9, 1.0), st.integers(1, 2))
def test_what_is_below_the_margin_reads_below_it(margin_um: int, share: float, digits: int) -> None:
    margin = margin_um * 1e-6
    distance = margin * (1.0 - share)
    shown, wanted = (float(each.split()[0]) for each in too_near(distance, margin, digits).split("mm, "))
    assert 0.0 <= shown < wanted
    assert shown == contact_mm(distance, digits)


def test_bodies_that_overlap_are_zero_apart() -> None:
    assert too_near(-0.02, 5.0 * MM) == "0.00 mm, 5 wanted"


def test_a_simulation_says_a_contact_just_below_the_margin() -> None:
    [found] = simulate("G1010\nG1 Z44.996 F6000\nG1 X150", mill(MARGIN, VISE)).report["diagnostics"]
    assert said(found) == (4.99, 5.0)


async def test_a_server_says_a_contact_just_below_the_margin(start: Start) -> None:
    cell = start(mill("[clearance]\nmargin_mm = 5.006", VISE))
    program = await cell.run("G1010", "G1 Z44.9955 F6000", "G1 X150")
    assert place(cell, 2) == pytest.approx(44.9955)
    assert said(program.fault) == (4.99, 5.006)


def test_a_lost_drive_is_reported_as_it_is_said() -> None:
    assert Lost(4.96 * MM, 0.0, 1, shown=True).distance_mm(5.0 * MM) == 4.9
    assert Lost(5.04 * MM, 0.0, 1, shown=True).distance_mm(5.0 * MM) == 5.0
    post = block("post", (208.0, 0.0, 130.0), 20.0)
    found = judged(["G1010", "G1 X100 F12000", "G1 X0"], parse_machine("\n".join((MILL, TOOL, MARGIN, post))))
    [diagnostic] = found.report["diagnostics"]
    shown, wanted = said(diagnostic)
    assert shown < wanted == 5.0
    lost = found.report["clearance"]["lost_drives"]
    assert [each["least_mm"] for each in lost["pairs"]] == [shown]
