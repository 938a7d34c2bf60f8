"""What came of a fault: counted in cycles, from the log of the bus and the telemetry of the run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tests.e2e_can.bus_log import Logged
from tests.e2e_can.cycles import Array, Rows, begins_to_brake, comes_to_rest, first_torques, jumps


@dataclass(frozen=True)
class Outcome:
    """One row of the table. Cycles count from the first one in which the fault can be seen.

    Attributes:
        fault: its name. code, axis, line: as reported, of the first report. message: of the report.
        reported: cycle of the report. braked: first cycle whose setpoints are slower. rested: first cycle
            in which the group's other axes stand.
        latch: the code with which a motion was refused before G1000.
        recovered: G1000, G1010 and a motion went well.
        jump: greatest difference of target and encoder when the drive was energized again [counts].
    """

    fault: str
    code: str = ""
    axis: int | None = None
    line: int = 0
    message: str = ""
    reported: int | None = None
    braked: int | None = None
    rested: int | None = None
    latch: str = ""
    recovered: bool = False
    jump: int | None = None


@dataclass(frozen=True)
class Stop:
    """Cycles from the first sign on."""

    reported: int
    braked: int | None
    rested: int | None


def measure_stop(rows: Rows, visible: int, reported_s: float, others: Sequence[int]) -> Stop:
    """From the first sign of a fault to the group's rest.

    Args:
        visible: row of the first sign. reported_s: executor time of the report.
        others: columns of the group's axes without a fault.
    """
    cycle_s = float(np.median(np.diff(rows.time_s)))
    speed = speed_of(rows, others)
    braked = begins_to_brake(speed, max(visible - 1, 0))
    rested = comes_to_rest(speed, visible)
    return Stop(
        round((reported_s - rows.time_s[visible]) / cycle_s),
        None if braked is None else braked - visible,
        None if rested is None else rested - visible,
    )


def speed_of(rows: Rows, columns: Sequence[int]) -> Array:
    """Along the path of some axes, shape (N,) [mm a cycle]; of the first row 0."""
    steps = np.diff(rows.setpoint[:, list(columns)], axis=0, prepend=rows.setpoint[:1, list(columns)])
    return np.asarray(np.linalg.norm(steps, axis=1))


def greatest_jump(frames: Sequence[Logged], nodes: Sequence[int], by_torque: int | None = None) -> int | None:
    """Of all times that one of these nodes was energized [counts]; None: none was.

    Args:
        by_torque: the node that gets torques: its first one counts [‰].
    """
    found = [
        jump
        for node in nodes
        for jump in (first_torques(frames, node) if node == by_torque else jumps(frames, node))
    ]
    return max(found, key=abs) if found else None


HEAD = (
    *("fault", "reported", "axis", "line", "report after", "braking after", "rest after", "latched"),
    *("G1000 + G1010", "jump"),
)


def table(outcomes: Sequence[Outcome]) -> str:
    """As Markdown."""
    lines = ["| " + " | ".join(HEAD) + " |", "|---" * len(HEAD) + "|"]
    for each in outcomes:
        cells = (
            each.fault,
            each.code or "nothing",
            shown(each.axis),
            shown(each.line or None),
            shown(each.reported),
            shown(each.braked),
            shown(each.rested),
            f"yes ({each.latch})" if each.latch else "–",
            "moves" if each.recovered else "NO",
            shown(each.jump),
        )
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def shown(value: int | None) -> str:
    return "–" if value is None else str(value)
