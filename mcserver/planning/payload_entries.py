"""Control entries for changes of payload along a program, for the executor's torques."""

from __future__ import annotations

from collections.abc import Collection

from mckinematics.dynamics import JointDynamics

from mcserver.executor.entries import Control, ControlKind
from mcserver.machine.machine_file import Machine
from mcserver.motion.canonical import FeedGroup, MotionLine, RapidGroup


class PayloadEntries:
    """Notes the tools chosen as a line is planned, and makes an entry of them where it starts.

    Args:
        dynamics: of the machine's joints; None: no torques are computed.
    """

    def __init__(self, machine: Machine, dynamics: JointDynamics | None) -> None:
        fed = any(axis.drive.takes_torques for axis in machine.axes)
        self._dynamics = dynamics if fed else None
        self._noted = 0
        self._at: dict[int, int] = {}

    def note(self, line: MotionLine) -> None:
        """Note the tools chosen for a line, if they have changed."""
        if self._dynamics is None:
            return
        for group in line.groups:
            if isinstance(group, FeedGroup | RapidGroup):
                tools = self._dynamics.bits_of(group.carried)
                if tools != self._noted:
                    self._noted = self._at[line.line] = tools

    def forget(self) -> None:
        """Note the tools again with the next line: other programs may have chosen theirs since."""
        self._noted = -1

    @property
    def lines(self) -> Collection[int]:
        """Lines at whose start a payload changes."""
        return self._at.keys()

    def at(self, u: float, line: int) -> list[Control]:
        """Return the entry for the start of a line, at u [cycles], once; empty where nothing changes."""
        tools = self._at.pop(line, None)
        return [] if tools is None else [Control(ControlKind.PAYLOAD, u, line, operation=tools)]
