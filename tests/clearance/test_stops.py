"""``simulate --stops``: holds, aborts and emergency stops stay clear from every cycle, or a line is named."""

from __future__ import annotations

import json
import random
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from mcserver.clearance.scene import Scene
from mcserver.cli.app import run_command_line
from mcserver.errors import ConfigurationError
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.planning.pipeline import Pipeline
from mcserver.planning.start_state import StartState
from mcserver.simulation.simulation import Simulation, simulate_lines
from mcserver.simulation.virtual_executor import VirtualExecutor
from mcserver.units import MM
from tests.clearance.machines import MILL, TOOL, VISE, mill

ORDERS = ("hold", "abort", "estop")


def judged(lines: Sequence[str], machine: Machine) -> Simulation:
    return simulate_lines(lambda: iter(lines), machine, stops=True)


def stopped(
    lines: Sequence[str], machine: Machine, cycle: int, order: str
) -> tuple[NDArray[np.float64], bool]:
    """Setpoints of every cycle (n, K) [m] of a run that is stopped in one, and whether it was over."""
    executor = VirtualExecutor(machine)
    executor.open_slot(0, (1 << len(machine.axes)) - 1)
    rows: list[NDArray[np.float64]] = []
    executor.recorder = lambda _t, _line, setpoint, _actual: rows.append(setpoint.copy())
    pipeline = Pipeline(machine, executor.sink(0), start=StartState.of(machine))
    pipeline.lines.put(1, list(lines))
    pipeline.lines.closed = True
    while len(rows) < cycle:
        while pipeline.pump():
            pass
        executor.step(1)
        for event in executor.events():
            pipeline.on_event(event)
    ended = executor.at_rest
    if order == "hold":
        executor.mailbox.set_hold(True, 0)
    elif order == "abort":
        executor.mailbox.abort(0)
    else:
        executor.mailbox.emergency_stop()
    # longer than any stop takes
    executor.step(600)
    return np.array(rows), ended


def least_of(machine: Machine, rows: NDArray[np.float64]) -> float:
    """The least distance of any pair in any cycle [mm]."""
    scene = Scene(machine)
    least = np.inf
    for row in rows[np.append(True, np.diff(rows, axis=0).any(axis=1))]:
        scene.place(row)
        least = min(least, *(scene.distance(pair) for pair in range(len(scene.pairs))))
    return float(least) / MM


def random_program(seed: int) -> list[str]:
    draw = random.Random(seed)
    lines = ["G1010"]
    for _ in range(draw.randint(2, 5)):
        letters = draw.sample("XYZ", draw.randint(1, 3))
        low = {"X": 0.0, "Y": -80.0, "Z": draw.choice((0.0, 42.0, 60.0))}
        words = [f"{letter}{draw.uniform(low[letter], 200.0):.2f}" for letter in letters]
        lines.append(f"{draw.choice(('G0', 'G1020', 'G1 F12000', 'G1 F3000'))} {' '.join(words)}")
    return lines


def brute_force(seed: int, stops: int) -> tuple[bool, float]:
    """Whether a random program was found clear with all its stops, and the least distance of some of them."""
    machine, lines, draw = mill(VISE), random_program(seed), random.Random(seed)
    found = judged(lines, machine)
    if not found.report["ok"]:
        return False, np.inf
    cycles = round(found.report["duration_s"] * machine.cycle_hz)
    picked = [(draw.randint(5, max(6, cycles)), draw.choice(ORDERS)) for _ in range(stops)]
    return True, min(least_of(machine, stopped(lines, machine, *each)[0]) for each in picked)


@pytest.mark.parametrize("seed", range(4))
def test_what_is_found_clear_stays_clear_whenever_it_is_stopped(seed: int) -> None:
    assert brute_force(seed, 2)[1] >= 0.98


def test_a_rapid_that_is_clear_alone_and_not_when_it_is_stopped_is_named() -> None:
    # X and Z come past the corner of the vise together; a hold on the way lets each stop in its own time
    lines = ["G1010", "G0 X150 Z45", "G0 X260 Z-20"]
    machine = mill(VISE)
    assert simulate_lines(
        lambda: iter(["G1010", "G1 X150 Z45 F6000", "G1 X260 Z45"]), machine, stops=True
    ).report["ok"]
    found = judged(lines, machine)
    assert [(each["code"], each["line"]) for each in found.report["diagnostics"]] == [("MC320", 3)]
    assert found.exit_code == 1


def test_feed_lines_are_judged_alike_with_stops_and_without() -> None:
    machine = mill(VISE)
    for lines, faulty in (
        (["G1010", "G1 Z20 F6000", "G1 X150"], 3),
        (["G1010", "G1 Z60 F6000", "G1 X150"], 0),
    ):
        for stops in (False, True):
            found = simulate_lines(lambda lines=lines: iter(lines), machine, stops=stops)  # type: ignore[misc]
            assert [each["line"] for each in found.report["diagnostics"]] == ([faulty] if faulty else [])


def test_the_command_says_that_stops_stay_clear(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    machine, program = tmp_path / "mill.toml", tmp_path / "a.gcode"
    machine.write_text("\n".join((MILL, TOOL, VISE)))
    program.write_text("G1010\nG1 Z60 F6000\nG0 X150\n")
    command = ["simulate", str(program), "--machine", str(machine), "--stops"]
    assert run_command_line(command) == 0
    assert "emergency stops stay clear" in capfd.readouterr().out
    assert run_command_line([*command, "--json"]) == 0
    assert json.loads(capfd.readouterr().out)["clearance"]["stops"]
    program.write_text("G1010\nG0 Z20\nG0 X150\n")
    assert run_command_line(command) == 1
    assert "MC320" in capfd.readouterr().err


def test_stops_of_a_machine_without_bodies_cannot_be_judged() -> None:
    with pytest.raises(ConfigurationError, match="names no bodies"):
        judged(["G1010"], parse_machine(MILL))
