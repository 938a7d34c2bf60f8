"""Captures of axes that are energized already (D-40, D-14): what stops for them, and what does not."""

from __future__ import annotations

import numpy as np
import pytest

from mcserver.executor.entries import EventKind
from mcserver.machine.machine_file import Machine, parse_machine
from tests.executor.planned import Planned


def machine(dialect: str) -> Machine:
    axes = "".join(
        f'[[axis]]\nindex = {index}\ntype = "{kind}"\nmax_velocity = 100.0\nmax_acceleration = 1000.0\n'
        f'max_jerk = 50000.0\n[axis.drive]\nkind = "simulated"\ninitial_position = 0.0\n'
        for index, kind in enumerate(("linear", "linear", "rotary", "rotary"))
    )
    return parse_machine(f'[machine]\nname = "m"\n[dialect]\n{dialect}\n{axes}')


FLOW = [f"G01 [0]{x} [1]{x % 2}" for x in range(1, 12)]
FLOW += [f"G01 [0]{x} [1]{x % 2} [2]{x}" for x in range(12, 20)]


@pytest.mark.parametrize("again", ["G1010", "G1010 P0 G1010 P1 G1010 P2"])
def test_a_second_capture_asks_for_all_its_axes_before_motion(again: str) -> None:
    text = "\n".join(["G1010", "G04 P0.01", again, "G64 G94 F6000", *FLOW])
    run = Planned(machine('profile = "reference"'), text)
    while not run.ended:
        run.step(50)
    assert run.faults == []
    # one for each capture, and none where axis 2 is named first
    assert len(run.of(EventKind.SETTLED)) == 1 + again.count("G1010")
    moving = np.abs(np.diff(np.array(run.rows)[:, 0])) > 1e-9
    (ways,) = np.nonzero(moving)
    assert moving[ways[0] : ways[-1]].all()


def test_a_capture_leaves_an_axis_that_turns_as_it_is() -> None:
    text = "\n".join(["G1010", "G1030 [3]10", "G04 P0.5", "G1010", "G64 G94 F6000", *FLOW])
    run = Planned(machine('profile = "reference"'), text)
    while not run.ended:
        run.step(50)
    assert run.faults == []
    turning = np.abs(np.diff(np.array(run.actuals)[:, 3]))
    assert turning[400:].min() > 0.0
