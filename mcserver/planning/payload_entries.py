"""Where along a program the payloads of its tools change, for the executor's torques."""

from __future__ import annotations

from collections.abc import Collection

from mckinematics.dynamics import JointDynamics

from mcserver.executor.entries import Control, ControlKind
from mcserver.machine.machine_file import Machine
from mcserver.motion.canonical import FeedGroup, MotionLine, RapidGroup


class PayloadEntries:
    """Notes which tools are chosen when a line is planned, for the moment at which it starts.

    Args:
        dynamics: of the machine's joints; None: nobody asks for torques.
    """

    def __init__(self, machine: Machine, dynamics: JointDynamics | None) -> None:
        fed = any(axis.drive.takes_torques for axis in machine.axes)
        self._dynamics = dynamics if fed else None
        self._noted = 0
        self._at: dict[int, int] = {}

    def note(self, line: MotionLine) -> None:
        """Note the tools chosen for a line, if they are others than for the lines before."""
        if self._dynamics is None:
            return
        for group in line.groups:
            if isinstance(group, FeedGroup | RapidGroup):
                tools = self._dynamics.bits_of(group.carried)
                if tools != self._noted:
                    self._noted = self._at[line.line] = tools

    def forget(self) -> None:
        """Have the tools noted anew with the next line: others may have chosen theirs since."""
        self._noted = -1

    @property
    def lines(self) -> Collection[int]:
        """Lines at whose start something changes."""
        return self._at.keys()

    def at(self, u: float, line: int) -> list[Control]:
        """Take the entry noted for the start of a line, at u [cycles]; empty where nothing changes."""
        tools = self._at.pop(line, None)
        return [] if tools is None else [Control(ControlKind.PAYLOAD, u, line, operation=tools)]
