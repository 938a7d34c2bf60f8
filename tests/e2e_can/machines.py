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
# by axis; the last one has a home switch on its drive
MIXED = ("csp", "ip", "cst", "pp", "csp")
POINTED, HOMED = 3, 4
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


def in_mode(raw: Raw, index: int, mode: str) -> None:
    """Give an axis's drive another mode, and all axes a pace at which a motion lasts for some seconds."""
    for axis in raw["axis"]:
        axis |= {"max_velocity": 100.0, "max_acceleration": 1000.0}
    section = raw["axis"][index]
    section["drive"] |= {"mode": mode}
    if mode == "cst":
        # 0.6 N·m accelerate by 1900 mm/s²; at 50 Hz the loop is so soft that friction moves it by 0.4 mm
        section["drive"] |= {"rated_torque": 0.6, "inertia": 0.0005, "friction_decel": 2.0}
        section["in_position"] = 1.0


def mixed(addresses: Sequence[str], cycle_hz: float) -> Raw:
    """One axis for each mode (csp, ip, cst, pp) and one that homes by its drive's switch; pins of a drive."""
    raw = slides(addresses, cycle_hz, len(MIXED))
    for index, mode in enumerate(MIXED):
        in_mode(raw, index, mode)
    switched = raw["axis"][HOMED]
    switched["drive"] |= {"home_switch": [-1000.0, -20.0], "initial_position": 0.0}
    switched["homing"] = {"method": "switch", "velocity": 50.0, "latch_velocity": 5.0, "position": 1.0}
    pin = {"drive": 0, "bit": 17}
    raw["input"] = [{"number": 0, "name": "guard", "source": pin}]
    raw["output"] = [{"number": 0, "name": "brake", "target": {**pin, "bit": 16}}]
    return raw


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
    """The same axes with drives that follow exactly and are at home; without inputs and outputs."""
    axes = [
        {
            **{key: value for key, value in axis.items() if key != "homing"},
            "drive": {"kind": "ideal", "initial_position": axis["drive"]["initial_position"]},
        }
        for axis in raw["axis"]
    ]
    on_the_buses = ("bus", "input", "output")
    return {**{key: value for key, value in raw.items() if key not in on_the_buses}, "axis": axes}


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
