"""Publish homing and probing as events: which axes are homed, and where a probe tripped."""

from __future__ import annotations

from collections.abc import Sequence
from types import MappingProxyType

from mcserver.executor.entries import EventKind, ExecutorEvent, HomingPhase
from mcserver.machine.axis import Axis
from mcserver.motion.canonical import MESH_OF_FILE, MeshUse
from mcserver.service.event_log import EventLog
from mcserver.service.references import References
from mcserver.service.reports import BedMeshState, ProbeStatus

# What an axis does while it is homed, for people.
PHASES = MappingProxyType(
    {
        HomingPhase.START: "off the switch, the search begins",
        HomingPhase.RELEASE: "the switch is active: off it first",
        HomingPhase.APPROACH: "searching",
        HomingPhase.BACK_OFF: "found, backing off",
        HomingPhase.LATCH: "slowly to it again",
        HomingPhase.INDEX: "on to the index",
        HomingPhase.REFERENCE: "found, coming to rest",
        HomingPhase.DEPART: "homed, going to its place",
        HomingPhase.DRIVE: "the drive homes itself",
        HomingPhase.HOLD: "the drive is at home",
        HomingPhase.DONE: "done",
    }
)


class AxisReports:
    """Publishes homing and probing.

    Args:
        axes: of the machine, in the order of its columns. references: updated when an axis is homed.

    Attributes:
        probe: result of the last probing move; None before the first.
        offsets: of axes that got a reference since this start, position less encoder reading [m or rad].
        mesh: what holds of the mesh of the bed.
    """

    def __init__(self, axes: Sequence[Axis], references: References, events: EventLog) -> None:
        self._axes = axes
        self._references = references
        self._events = events
        self.probe: ProbeStatus | None = None
        self.offsets: dict[int, float] = {}
        self.mesh = MESH_OF_FILE

    @property
    def bed_mesh(self) -> BedMeshState:
        """The mesh of the bed that counts, if programs probe one."""
        if MeshUse.ON not in self.mesh:
            return "off"
        return "probed" if MeshUse.MET in self.mesh else "file"

    def handle(self, event: ExecutorEvent, program: str | None) -> bool:
        """Handle an event of a single axis; return False for other kinds.

        Args:
            program: id of the event's program.
        """
        if event.kind is EventKind.PROBED:
            self._probed(event, program)
        elif event.kind is EventKind.MESHED:
            self.mesh = MeshUse(event.token).behind(self.mesh)
        elif event.kind is EventKind.HOMING:
            phase = PHASES[HomingPhase(event.token)]
            self._events.publish("axis.homing", message=phase, axis=event.axis, program=program)
        elif event.kind is EventKind.HOMED:
            offset, reading = event.values
            self.offsets[event.axis] = offset
            self._references.keep(event.axis, offset, reading)
            self._events.publish("axis.homed", message="", axis=event.axis, program=program)
        elif event.kind is EventKind.UNHOMED:
            self._references.forget(event.axis)
            reason = f"MC{event.code}" if event.code else ""
            self._events.publish("axis.unhomed", reason=reason, message="", axis=event.axis, program=program)
        else:
            return False
        return True

    def _probed(self, event: ExecutorEvent, program: str | None) -> None:
        positions = {
            str(axis.index): value / axis.type.si_per_unit
            for axis, value in zip(self._axes, event.values, strict=True)
        }
        self.probe = ProbeStatus(program or "", event.line, bool(event.token), positions, event.time)
        self._events.publish("probe", program=program, line=event.line, probe=self.probe)
