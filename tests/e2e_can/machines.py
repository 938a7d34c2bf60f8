"""Machine files of twelve CANopen drives, over any buses and at any rate."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any

from tests.e2e.servers import ROOT

AXES = 12
# 16 bits a motor turn; 50:1 gears at the joints, 10 mm screws on the slides
INCREMENTS = 1 << 16
JOINT_GEAR = (50, 1)
SCREW_MM = 10.0
# where it is not the subject, a process may be late now and then, as a busy computer's is
PATIENT = {"heartbeat_ms": 500, "command_timeout_ms": 2000}
PATIENT_CYCLES = 50
FOLLOWING_MM = 50.0
Raw = dict[str, Any]


def dog(addresses: Sequence[str], cycle_hz: float) -> Raw:
    """The built-in robot dog, each leg's drives on a bus of their own where there are four."""
    raw = tomllib.loads(
        resources.files("mcserver.machine.builtin").joinpath("robot-dog.toml").read_text("utf-8")
    )
    raw["kinematics"]["urdf"] = str(ROOT / "kinematics" / "mckinematics" / "models" / "robot-dog.urdf")
    for axis in raw["axis"]:
        axis["drive"] = {
            **can_drive(addresses, axis["index"]),
            "initial_position": axis["drive"]["initial_position"],
            "gear": list(JOINT_GEAR),
            "feed": [360.0, 1.0],
        }
    raw["machine"]["cycle_hz"] = cycle_hz
    raw["bus"] = buses(addresses)
    return raw


def slides(addresses: Sequence[str], cycle_hz: float, count: int = AXES) -> Raw:
    """Linear axes, X Y Z first, fit for the arcs of the reference at their size."""
    axis = {
        "type": "linear",
        "max_velocity": 1000.0,
        "max_acceleration": 5000.0,
        "max_jerk": 100000.0,
        "min_position": -5000.0,
        "max_position": 5000.0,
        "in_position": 0.01,
        "max_following_error": FOLLOWING_MM,
    }
    drives = [
        {**can_drive(addresses, index, count), "feed": [SCREW_MM, 1.0], "initial_position": 10.0 * index}
        for index in range(count)
    ]
    return {
        "machine": {"name": "slides", "cycle_hz": cycle_hz},
        "axis": [{**axis, "index": index, "drive": drive} for index, drive in enumerate(drives)],
        "bus": buses(addresses),
    }


def can_drive(addresses: Sequence[str], index: int, count: int = AXES) -> Raw:
    """A drive's section: node = axis + 1, the axes in equal shares over the buses."""
    bus = index * len(addresses) // count
    return {
        "kind": "cia402",
        "bus": f"bus{bus}",
        "node": index + 1,
        "encoder": [INCREMENTS, 1],
        **PATIENT,
    }


def buses(addresses: Sequence[str], silence_cycles: int = PATIENT_CYCLES) -> list[Raw]:
    return [
        {"name": f"bus{number}", "address": address, "silence_cycles": silence_cycles}
        for number, address in enumerate(addresses)
    ]


def ideal(raw: Raw) -> Raw:
    """The same machine with drives that follow exactly."""
    axes = [
        {
            **axis,
            "drive": {"kind": "ideal", "initial_position": axis["drive"]["initial_position"]},
        }
        for axis in raw["axis"]
    ]
    return {**{key: value for key, value in raw.items() if key != "bus"}, "axis": axes}


def write(raw: Raw, path: Path) -> str:
    """As a machine file; gives its path."""
    path.write_text(toml(raw), "utf-8")
    return str(path)


def toml(raw: Raw) -> str:
    """Tables of plain values, and lists of such tables, each with tables in it."""
    lines: list[str] = []
    for name, value in raw.items():
        for table in value if isinstance(value, list) else [value]:
            lines += ["", f"[[{name}]]" if isinstance(value, list) else f"[{name}]"]
            lines += [
                f"{key} = {json.dumps(each)}" for key, each in table.items() if not isinstance(each, dict)
            ]
            for key, inner in table.items():
                if isinstance(inner, dict):
                    lines += [f"[{name}.{key}]", *(f"{k} = {json.dumps(v)}" for k, v in inner.items())]
    return "\n".join(lines) + "\n"
