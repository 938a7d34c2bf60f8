"""Work offsets of a check or a simulation, as `--zero` of the command line gives them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable

import msgspec

from mcserver.errors import UsageFault
from mcserver.gcode.text.words import AXIS_LETTERS
from mcserver.machine.machine_file import Machine
from mcserver.machine.work_systems import ANGLE, SYSTEM_NUMBERS
from mcserver.units import AxisType

_ENTRY = re.compile(r"(?:(?P<system>G5[4-9](?:\.[1-3])?):)?(?P<axis>[A-Z]|\[?[0-9]{1,2}\]?)=(?P<at>[^=]+)")


def with_zeros(machine: Machine, entries: Iterable[str]) -> Machine:
    """Return the machine with work coordinate systems that its programs start with.

    Args:
        entries: such as ``X=10,Y=20`` or ``G55:Z=-3``: where a system, G54 if none is named, has the zero of
            an axis [mm or deg of the machine]; ``R=30``: by which it is turned about Z [deg].

    Raises:
        UsageFault: MC017 an entry that cannot be meant as it stands, or a machine without such systems.
    """
    systems = {number: dict(origin) for number, origin in machine.dialect.systems.items()}
    written = [part.strip() for entry in entries for part in entry.split(",")]
    if not written:
        return machine
    if machine.dialect.profile not in ("cnc", "robot"):
        raise UsageFault(
            "MC017",
            f"--zero: programs of the profile {machine.dialect.profile} have no work offsets",
            'they belong to [dialect] profile = "cnc" and "robot"',
        )
    axes = {axis.index: axis for axis in machine.axes}
    letters = {**AXIS_LETTERS, **machine.dialect.letters}
    for part in written:
        match = _ENTRY.fullmatch(part.upper())
        if match is None:
            raise UsageFault(
                "MC017", f"--zero: {part!r} is no zero of an axis", "write it as X=10 or G55:X=10"
            )
        name = match["axis"].strip("[]")
        number = int(name) if name.isdecimal() else letters.get(name, ANGLE)
        axis = axes.get(number)
        turned = [each.type for each in map(axes.get, (0, 1)) if name == "R" and each is not None]
        if name == "R" and turned != [AxisType.LINEAR] * 2:
            raise UsageFault("MC017", "--zero: R turns linear axes X and Y", "leave it out on this machine")
        kind = AxisType.ROTARY if axis is None else axis.type
        if axis is None and name != "R":
            raise UsageFault("MC017", f"--zero: the machine has no axis {name}", "name an axis of its file")
        try:
            at = float(match["at"])
        except ValueError:
            at = math.nan
        if not abs(at) <= 1e9:
            unit = "mm" if kind is AxisType.LINEAR else "deg"
            raise UsageFault("MC017", f"--zero: {match['at']!r} is not a number", f"give {unit}")
        system = SYSTEM_NUMBERS[match["system"] or "G54"]
        systems.setdefault(system, {})[number] = at * kind.si_per_unit
    dialect = msgspec.structs.replace(machine.dialect, systems=systems)
    return msgspec.structs.replace(machine, dialect=dialect)
