"""Planning a gait line of four legs, and how true the tips stay to their programmed paths."""

from __future__ import annotations

import importlib.util

from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.machine.machine_file import load_machine
from tests.bench.figures import Figure, NotAvailable, processor_seconds

SETUP = ("G1010", "G93 F60")
STEPS = (
    "G01 T3 X-159 Y-400 Z800 G01 T12 X159 Y-400 Z-100 G02 T6 Y-400 Z0 R500 G02 T9 Y-400 Z-800 R500",
    "G01 T6 X159 Y-400 Z800 G01 T9 X-159 Y-400 Z-100 G02 T3 Y-400 Z0 R500 G02 T12 Y-400 Z-800 R500",
)
LINES = 20
WAYPOINTS = 100


def measure() -> list[Figure]:
    """One line: four tool paths solved from end to end, beside forward kinematics of as many poses."""
    if importlib.util.find_spec("pinocchio") is None:
        raise NotAvailable("no Pinocchio: pip install pin scipy")
    from mckinematics.solver import MachineKinematics

    machine = load_machine("robot-dog")
    kinematics = MachineKinematics(machine)

    def plan() -> None:
        interpreter = Interpreter(machine, kinematics=kinematics)
        for number, line in enumerate((*SETUP, *STEPS * (LINES // 2)), start=1):
            interpreter.interpret_text(line, number)

    def poses() -> None:
        joints = {axis.index: axis.initial_position for axis in machine.axes}
        for tool in kinematics.tools:
            for _ in range(WAYPOINTS):
                kinematics.pose(tool, joints)

    taken = 1000.0 * processor_seconds(plan) / LINES
    floor = 1000.0 * processor_seconds(poses)
    return [
        Figure(
            "a line of four legs, parsed and solved",
            taken,
            "ms",
            floor,
            f"4 × {WAYPOINTS} forward poses",
            "≤ 10 ms",
        )
    ]
