"""Events as log messages."""

from __future__ import annotations

from foxglove_schemas_protobuf.Log_pb2 import Log

from mcserver.foxglove.channels import timestamp
from mcserver.service.reports import Event

ERRORS = frozenset({"fault", "estop"})
WARNINGS = frozenset(
    {"warning", "line.rejected", "client.gone", "axis.unhomed"}
    | {"drive.emergency", "drive.lost", "drive.rebooted", "drive.failed", "bus.foreign_master"}
)
# of these there are as many as lines
UNSAID = frozenset({"lines.started", "lines.ended"})


def log_message(event: Event, time_ns: int) -> bytes | None:
    """Write an event as ``foxglove.Log``; None: one of lines."""
    if event.kind in UNSAID:
        return None
    level = Log.INFO
    if event.kind in ERRORS:
        level = Log.ERROR
    elif event.kind in WARNINGS:
        level = Log.WARNING
    said = [event.kind, event.state, event.reason, event.message]
    if event.axis is not None:
        said.append(f"axis {event.axis}")
    if event.fault is not None:
        said += [event.fault.code, event.fault.message]
    said += [f"{each.code} {each.message}" for each in event.diagnostics]
    written: bytes = Log(
        timestamp=timestamp(time_ns),
        level=level,
        name=event.client or "machine",
        file=event.program or "",
        line=event.line,
        message=" ".join(str(word) for word in said if word),
    ).SerializeToString()
    return written
