"""The part of docs/threading.md, from its corner to its last thread."""

from __future__ import annotations

from pathlib import Path

import pytest

from mcserver.machine.machine_file import load_machine
from mcserver.simulation.simulation import simulate

EXAMPLES = Path(__file__).parents[2] / "examples"


def test_a_part_is_probed_milled_drilled_and_tapped_where_it_lies() -> None:
    machine = load_machine(str(EXAMPLES / "mill.toml"))
    text = (EXAMPLES / "mill-part.gcode").read_text("utf-8")
    # the tap goes deepest, and there is one hole
    text = text.replace("Z-12 R5 F300", "Z-18 R5 F300").replace("\nX50\nY30\nX10\nG80", "\nG80")
    # it is looked at where the part is, not how long it takes
    text = text.replace("F200", "F1000").replace("G38.2 Z-120 F300", "G0 Z-60\nG38.2 Z-120 F300")
    found = simulate(text, machine)
    assert found.exit_code == 0, found.report["diagnostics"]
    # by the planes that the probe meets, the radius of its ball and its length: the end mill's centre goes
    # round the plate at its radius, and the tap, which its spindle leads, down to its depth
    assert found.report["axes"]["0"]["max"] == pytest.approx(103.0 + 60.0 + 4.0, abs=1e-3)
    assert found.report["axes"]["2"]["min"] == pytest.approx(-100.0 + 45.0 - 18.0, abs=0.01)
