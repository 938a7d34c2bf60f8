"""Faults on demand: what a simulated drive does wrong, and the requests that ask for it.

A request names a fault and its values, such as ``{"fault": "late_tpdo", "syncs": 2}``.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

MAX_SYNCS = 1000
MAX_DELAY_S = 60.0

# Fault → its values with (least, greatest, default); None: it has to be given.
FAULTS: Mapping[str, Mapping[str, tuple[float, float, float | None]]] = MappingProxyType(
    {
        "mute": {},
        "late_tpdo": {"syncs": (1, MAX_SYNCS, 1)},
        "short_tpdo": {},
        "emcy": {"code": (1, 0xFFFF, 0x1000), "fatal": (0, 1, 1)},
        "stuck": {},
        "sdo_abort": {
            "index": (0x1000, 0xFFFF, None),
            "subindex": (-1, 255, -1),
            "code": (1, 0xFFFFFFFF, 0x08000000),
        },
        "sdo_delay": {"seconds": (0.0, MAX_DELAY_S, 1.0)},
        "reboot": {},
        "heartbeat_stop": {},
        "following_error": {"trip": (0, 1, 0)},
        "drop_sync": {"syncs": (1, MAX_SYNCS, 1)},
        "ignore_setpoints": {},
        "reverse_torque": {},
        "inputs": {"bits": (0, 0xFFFFFFFF, None)},
        "clear": {},
    }
)
# The same of drives on EtherCAT, which have no TPDOs and no heartbeats.
ETHERCAT_FAULTS: Mapping[str, Mapping[str, tuple[float, float, float | None]]] = MappingProxyType(
    {
        "frame_loss": {"frames": (1, MAX_SYNCS, 1)},
        "safe_op": {"code": (1, 0xFFFF, 0x1B)},
        "unplug": {},
        "cut": {},
        **{
            name: values
            for name, values in FAULTS.items()
            if name not in ("late_tpdo", "short_tpdo", "heartbeat_stop")
        },
    }
)


class BadRequest(Exception):
    """A request that cannot be meant; the message says why."""


def values_of(
    request: Mapping[str, object],
    fault: str,
    faults: Mapping[str, Mapping[str, tuple[float, float, float | None]]] = FAULTS,
) -> dict[str, float]:
    """Return the values of a request, defaults filled in.

    Args:
        faults: that the drive has.

    Raises:
        BadRequest: no such fault, or a value that does not fit.
    """
    known = faults.get(fault)
    if known is None:
        raise BadRequest(f"there is no fault {fault!r}; there are {', '.join(faults)}")
    unknown = set(request) - {"node", "bus", "fault", *known}
    if unknown:
        raise BadRequest(f"{fault} has no {min(unknown)!r}; it takes {', '.join(known) or 'no values'}")
    values = {}
    for name, (least, greatest, default) in known.items():
        value = request.get(name, default)
        if not isinstance(value, (int, float)) or not least <= value <= greatest:
            raise BadRequest(f"{fault} needs {name!r}, a number from {least:g} to {greatest:g}")
        values[name] = value
    return values


@dataclass
class Misbehaviour:
    """What a node does wrong now.

    Attributes:
        mute: transmits nothing. late_syncs: TPDOs leave so many SYNCs late, with their old content.
        short: TPDOs lack their last byte. stuck: controlwords are ignored. deaf_syncs: SYNCs still to miss.
        sdo_delay_s: SDO answers come so late.
    """

    mute: bool = False
    late_syncs: int = 0
    short: bool = False
    stuck: bool = False
    deaf_syncs: int = 0
    sdo_delay_s: float = 0.0
    late: dict[int, deque[bytes]] = field(default_factory=dict)

    def begin(self, fault: str, values: Mapping[str, float]) -> bool:
        """Inject a fault from now on; False: it is not one of those kept here.

        Args:
            values: as `values_of` gives them.
        """
        match fault:
            case "mute":
                self.mute = True
            case "late_tpdo":
                self.late_syncs = int(values["syncs"])
                self.late.clear()
            case "short_tpdo":
                self.short = True
            case "stuck":
                self.stuck = True
            case "drop_sync":
                self.deaf_syncs = int(values["syncs"])
            case "sdo_delay":
                self.sdo_delay_s = values["seconds"]
            case _:
                return False
        return True

    def tpdo(self, identifier: int, payload: bytes) -> bytes | None:
        """Return what leaves in place of a TPDO's payload."""
        if self.late_syncs:
            waiting = self.late.setdefault(identifier, deque(maxlen=MAX_SYNCS + 1))
            waiting.append(payload)
            if len(waiting) <= self.late_syncs:
                return None
            payload = waiting.popleft()
        return payload[:-1] if self.short else payload

    @property
    def active(self) -> list[str]:
        """Names of the faults that last."""
        flags = {
            "mute": self.mute,
            "late_tpdo": self.late_syncs > 0,
            "short_tpdo": self.short,
            "stuck": self.stuck,
            "drop_sync": self.deaf_syncs > 0,
            "sdo_delay": self.sdo_delay_s > 0.0,
        }
        return [name for name, on in flags.items() if on]
