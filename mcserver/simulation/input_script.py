"""Values of simulated inputs over time, as `mcserver simulate --input` gives them."""

from __future__ import annotations

import re
from collections.abc import Iterable

import msgspec

from mcserver.errors import UsageFault
from mcserver.machine.io_section import Input, ScriptedValue
from mcserver.machine.machine_file import Machine

_ENTRY = re.compile(r"(?P<name>[^=@]+)=(?P<value>[^=@]+?)(?:@(?P<time>[^=@]+))?")
_LEVELS = {"on": 1.0, "off": 0.0, "true": 1.0, "false": 0.0}


def with_inputs(machine: Machine, entries: Iterable[str]) -> Machine:
    """Return the machine with a script for inputs, behind that of its file.

    Args:
        entries: such as ``door=on@2.5``: an input by its name, or a digital one by its number, has this value
            from that second on, from the start without one.

    Raises:
        UsageFault: MC029 an entry that cannot be meant as it stands.
    """
    inputs = list(machine.inputs)
    for entry in entries:
        column, scripted = _read(machine, entry)
        one = inputs[column]
        script = sorted((*one.script, scripted), key=lambda each: each.at_s)
        # an input that has a source is simulated, too
        inputs[column] = msgspec.structs.replace(one, script=tuple(script), source=None)
    return msgspec.structs.replace(machine, inputs=tuple(inputs))


def _read(machine: Machine, entry: str) -> tuple[int, ScriptedValue]:
    match = _ENTRY.fullmatch(entry.strip())
    if match is None:
        raise UsageFault("MC029", f"{entry!r} is no input with a value", "write it as door=on@2.5")
    name = match["name"].strip()
    column = _column(machine.inputs, name)
    if column is None:
        known = ", ".join(each.name for each in machine.inputs) or "none"
        raise UsageFault("MC029", f"the machine has no input {name!r}", f"it has {known}")
    channel = machine.inputs[column]
    value = _number(match["value"], entry, levels=True)
    if channel.digital and value not in (0.0, 1.0):
        raise UsageFault("MC029", f"{entry!r}: {name} is a digital input", "give on or off")
    at_s = 0.0 if match["time"] is None else _number(match["time"].strip().removesuffix("s"), entry)
    if at_s < 0.0:
        raise UsageFault("MC029", f"{entry!r}: the time is negative", "give seconds from the start")
    return column, ScriptedValue(at_s, value)


def _column(inputs: tuple[Input, ...], name: str) -> int | None:
    for column, each in enumerate(inputs):
        if each.name == name:
            return column
    if name.isdecimal():
        for column, each in enumerate(inputs):
            if each.digital and each.number == int(name):
                return column
    return None


def _number(text: str, entry: str, *, levels: bool = False) -> float:
    text = text.strip().lower()
    if levels and text in _LEVELS:
        return _LEVELS[text]
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not abs(value) < 1e12:
        raise UsageFault("MC029", f"{entry!r}: {text!r} is not a number", "write it as door=on@2.5")
    return value
