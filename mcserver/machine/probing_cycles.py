"""Probing cycles as programs with numbers to enter: edges, corners, centres, tool length.

Each touches the work twice, the second time slowly, and sets the work coordinate system in force (`G10 L20
P0`) or a tool's length (`G10 L1`). Moves between contacts are at the height at which the cycle began. Moves
down are G38.3: after a contact in one, the next touch is a fault (MC457).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product

from mcserver.machine.button_section import PLACE, Button, ButtonArgument
from mcserver.machine.machine_file import Machine
from mcserver.units import AxisType

GROUP = "Probing"

_ARGUMENTS = (
    ButtonArgument("travel", 1.0, 500.0, 20.0, "mm"),
    ButtonArgument("feed", 1.0, 2000.0, 150.0, "mm/min"),
    ButtonArgument("slow", 1.0, 500.0, 25.0, "mm/min"),
    ButtonArgument("back", 0.1, 20.0, 1.0, "mm"),
    ButtonArgument("diameter", 0.0, 50.0, 3.0, "mm"),
    ButtonArgument("width", 1.0, 1000.0, 50.0, "mm"),
    ButtonArgument("clear", 1.0, 100.0, 10.0, "mm"),
    ButtonArgument("inset", 1.0, 100.0, 10.0, "mm"),
    ButtonArgument("depth", 0.5, 200.0, 8.0, "mm"),
    ButtonArgument("thickness", 0.0, 200.0, 0.0, "mm"),
    ButtonArgument("setter", -2000.0, 2000.0, 0.0, "mm"),
)
_POSITION = {"X": 5420, "Y": 5421, "Z": 5422}
_CONTACT = {"X": 5061, "Y": 5062, "Z": 5063}
# Fanuc's numbers of the same values (D-93)
_IN_MACRO_B = {"#5420": "#5041", "#5421": "#5042", "#5422": "#5043", "#<_abs_z>": "#5023"}
_HEAD = "G21 G90 G94 F{feed}"


def probing_cycles(machine: Machine) -> tuple[Button, ...]:
    """Return the cycles that a machine's axes allow; X Y Z are the axes 0, 1 and 2.

    Empty without a probe, and outside the profile ``cnc``, as the cycles compute (D-80).
    """
    if machine.probe is None or machine.dialect.profile != "cnc":
        return ()
    letters = {"XYZ"[axis.index] for axis in machine.axes if axis.index < 3 and axis.type is AxisType.LINEAR}
    texts = {}
    for axis, sign in product("XY", (1, -1)):
        texts[f"Edge {axis}, going {_shown(sign)}"] = _edge(axis, sign)
    texts["Top"] = _top()
    for along, across in product((1, -1), (1, -1)):
        name = f"Corner {'left' if along > 0 else 'right'} {'front' if across > 0 else 'back'}"
        texts[name] = _corner(along, across)
    texts["Centre of a hole"] = _hole()
    texts["Centre of a boss"] = _boss()
    texts["Tool length"] = _tool_length()
    numbers = _IN_MACRO_B if machine.dialect.fanuc else {}
    return tuple(_button(name, lines, numbers) for name, lines in texts.items() if letters >= _letters(lines))


def _button(name: str, lines: Sequence[str], numbers: Mapping[str, str]) -> Button:
    text = "\n".join(lines) + "\n"
    for written, other in numbers.items():
        text = text.replace(written, other)
    asked = set(PLACE.findall(text))
    return Button(name, text, argument=[each for each in _ARGUMENTS if each.name in asked], group=GROUP)


def _letters(lines: Sequence[str]) -> set[str]:
    """Return the axes that a cycle moves."""
    return {letter for line in lines if line.startswith("G") for letter in "XYZ" if f" {letter}" in line}


def _shown(sign: int) -> str:
    return "+" if sign > 0 else "−"


def _signed(sign: int) -> str:
    return "" if sign > 0 else "-"


def _touch(axis: str, sign: int) -> list[str]:
    """Touch the work, back off, and touch it again slowly; under G91."""
    to, away = f"{axis}{_signed(sign)}", f"{axis}{_signed(-sign)}"
    return [
        f"G38.2 {to}{{travel}} F{{feed}}",
        f"G1 {away}{{back}}",
        f"G38.2 {to}[2 * {{back}}] F{{slow}}",
        "F{feed}",
    ]


def _surface(axis: str, sign: int) -> str:
    """Return the surface position at the last contact: beyond it by the stylus' radius."""
    return f"#{_CONTACT[axis]} {'+' if sign > 0 else '-'} {{diameter}} / 2"


def _edge(axis: str, sign: int) -> list[str]:
    side = {("X", 1): "left of", ("X", -1): "right of", ("Y", 1): "before", ("Y", -1): "behind"}[axis, sign]
    return [
        f"(the stylus stands {side} the work, below its top)",
        _HEAD,
        f"#1 = #{_POSITION[axis]}",
        "G91",
        *_touch(axis, sign),
        f"#2 = [{_surface(axis, sign)}]",
        f"G90 G1 {axis}#1",
        f"G10 L20 P0 {axis}[#1 - #2]",
    ]


def _top() -> list[str]:
    return [
        "(the stylus stands above the work, or above a plate of that thickness on it)",
        _HEAD,
        "#1 = #5422",
        "G91",
        *_touch("Z", -1),
        "#2 = [#5063 - {thickness}]",
        "G90 G1 Z#1",
        "G10 L20 P0 Z[#1 - #2]",
    ]


def _corner(along: int, across: int) -> list[str]:
    x_in, x_out = ("+", "-") if along > 0 else ("-", "+")
    y_in, y_out = ("+", "-") if across > 0 else ("-", "+")
    return [
        "(the stylus stands above the corner, higher than anything beside it)",
        _HEAD,
        "#1 = #5420",
        "#2 = #5421",
        "#3 = #5422",
        f"G1 X[#1 {x_out} {{clear}}] Y[#2 {y_in} {{inset}}]",
        "G91 G38.3 Z-{depth}",
        *_touch("X", along),
        f"#4 = [{_surface('X', along)}]",
        f"G90 G1 X[#1 {x_out} {{clear}}]",
        "G1 Z#3",
        f"G1 X[#1 {x_in} {{inset}}] Y[#2 {y_out} {{clear}}]",
        "G91 G38.3 Z-{depth}",
        *_touch("Y", across),
        f"#5 = [{_surface('Y', across)}]",
        f"G90 G1 Y[#2 {y_out} {{clear}}]",
        "G1 Z#3",
        "G1 X#4 Y#5",
        "G10 L20 P0 X0 Y0",
    ]


def _hole() -> list[str]:
    lines = ["(the stylus stands in the hole, below its rim)", _HEAD]
    for axis in "XY":
        lines += [
            f"#1 = #{_POSITION[axis]}",
            "G91",
            *_touch(axis, -1),
            f"#2 = #{_CONTACT[axis]}",
            f"G90 G1 {axis}#1",
            "G91",
            *_touch(axis, 1),
            f"G90 G1 {axis}[[#2 + #{_CONTACT[axis]}] / 2]",
        ]
    return [*lines, "G10 L20 P0 X0 Y0"]


def _boss() -> list[str]:
    lines = ["(the stylus stands above the middle of the boss, higher than anything beside it)", _HEAD]
    lines.append("#3 = #5422")
    for axis in "XY":
        lines.append(f"#1 = #{_POSITION[axis]}")
        for sign, contact in ((1, "#2"), (-1, "#4")):
            outside = f"G90 G1 {axis}[#1 {'-' if sign > 0 else '+'} [{{width}} / 2 + {{clear}}]]"
            lines += [
                outside,
                "G91 G38.3 Z-{depth}",
                *_touch(axis, sign),
                f"{contact} = #{_CONTACT[axis]}",
                outside,
                "G1 Z#3",
            ]
        lines.append(f"G1 {axis}[[#2 + #4] / 2]")
    return [*lines, "G10 L20 P0 X0 Y0"]


def _tool_length() -> list[str]:
    return [
        "(a tool of M6 stands above the tool setter, whose top is at that height of the machine's Z)",
        _HEAD,
        "G49",
        "#1 = #5422",
        "G91",
        *_touch("Z", -1),
        "#2 = [#5063 + #<_abs_z> - #5422 - {setter}]",
        "G90 G1 Z#1",
        "G10 L1 P#5400 Z#2",
    ]
