"""Machines with bodies."""

from __future__ import annotations

from mcserver.machine.machine_file import Machine, builtin_text, parse_machine

_AXIS = """
[[axis]]
index = {}
type = "linear"
max_velocity = 200.0
max_acceleration = 2000.0
drive = {{ kind = "ideal", initial_position = {} }}
"""
MILL = '[machine]\nname = "mill"\n' + "".join(
    _AXIS.format(index, start) for index, start in enumerate((0.0, 0.0, 100.0))
)
TOOL = """
[[body]]
name = "tool"
shape = "cylinder"
radius_mm = 5.0
length_mm = 60.0
at_mm = [0.0, 0.0, 30.0]
carried_by = [0, 1, 2]
"""
VISE = """
[[body]]
name = "vise"
shape = "box"
size_mm = [100.0, 60.0, 40.0]
at_mm = [150.0, 0.0, 20.0]
"""


def mill(*more: str) -> Machine:
    """A portal whose tip is at X0 Y0 Z100, with the tool as a body."""
    return parse_machine("\n".join((MILL, TOOL, *more)))


def arm(*more: str) -> Machine:
    """The built-in arm with sections more."""
    return parse_machine("\n".join((builtin_text("arm6"), *more)))


def block(name: str, at_mm: tuple[float, ...], edge_mm: float) -> str:
    """A cube that stands still."""
    return f"""
[[body]]
name = "{name}"
shape = "box"
size_mm = [{edge_mm}, {edge_mm}, {edge_mm}]
at_mm = [{at_mm[0]}, {at_mm[1]}, {at_mm[2]}]
"""
