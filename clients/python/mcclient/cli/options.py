"""Options that every command has."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from mcclient.cli.output import carry_out
from mcclient.errors import RequestRefused
from mcclient.machine import Machine
from mcclient.starting import Starting
from mcclient.types import AxisInfo, Info

T = TypeVar("T")


def _complete_machine(incomplete: str) -> list[str]:
    import asyncio

    from mcclient.discovery import list_machines
    from mcclient.errors import MotionError

    try:
        found = asyncio.run(list_machines(timeout_s=0.5))
    except MotionError:
        return []
    return [name for name, _ in found if name.startswith(incomplete)]


MachineOption = Annotated[
    str | None,
    typer.Option(
        "--machine",
        "-m",
        metavar="NAME",
        envvar="MC_MACHINE",
        help="The machine, where there is more than one.",
        autocompletion=_complete_machine,
    ),
]
ConnectOption = Annotated[
    list[str] | None,
    typer.Option(
        "--connect",
        metavar="ENDPOINT",
        help="Zenoh endpoint of the server or a router; of several, the first that is reached. "
        "Default: $MC_CONNECT, else tcp/127.0.0.1:7447.",
    ),
]
ConfigOption = Annotated[
    Path | None,
    typer.Option(
        "--zenoh-config",
        metavar="PATH",
        help="A Zenoh configuration (JSON5), for TLS and passwords.",
        exists=True,
        dir_okay=False,
    ),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Answer with JSON on standard output.")]
ProgramOption = Annotated[
    str | None, typer.Option("--program", "-p", metavar="ID", help="One program; default: all.")
]

AxesOption = Annotated[
    str | None,
    typer.Option("--axes", metavar="LIST", help="Axes to lease, such as 0,1,4-6; default: all."),
]
AXIS_LIMIT = 63
# as G-code names the first axes
AXIS_LETTERS = "XYZABC"
LOOK_S = 2.0


@dataclass(frozen=True, slots=True)
class Target:
    """Which machine, and how it is reached."""

    machine: str | None
    connect: list[str] | None
    config_file: Path | None

    def carry_out(self, work: Callable[[Machine], Coroutine[Any, Any, T]], as_json: bool) -> T:
        """Do something with the machine while it is connected, and show the errors of that."""

        async def connected() -> T:
            async with self.open() as machine:
                return await work(machine)

        return carry_out(connected, as_json)

    def open(self) -> Starting[Machine]:
        """Connects as ``mcctl``."""
        return Machine.connect(
            self.machine,
            self.connect or None,
            client="mcctl",
            timeout_s=LOOK_S,
            config_file=self.config_file,
        )


def with_target(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command the options of its `Target`, which it takes by that name."""
    signature = inspect.signature(command, eval_str=True)
    if "target" not in signature.parameters:
        return command

    @functools.wraps(command)
    def call(machine: str | None, connect: list[str] | None, zenoh: Path | None, **others: object) -> None:
        command(target=Target(machine, connect, zenoh), **others)

    shown = {
        name: each.replace(kind=inspect.Parameter.KEYWORD_ONLY)
        for name, each in signature.parameters.items()
        if name != "target"
    }
    last = shown.pop("json", None)
    for name, option in (("machine", MachineOption), ("connect", ConnectOption), ("zenoh", ConfigOption)):
        shown[name] = inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=option)
    if last is not None:
        shown["json"] = last
    call.__signature__ = signature.replace(parameters=list(shown.values()))  # type: ignore[attr-defined]
    call.__annotations__ = {name: each.annotation for name, each in shown.items()}
    return call


def parse_axes(text: str | None) -> list[int] | None:
    """``0,1,4-6`` as axis numbers; None: all.

    Raises:
        RequestRefused: MC511 it is no list of axes.
    """
    if text is None:
        return None
    axes: set[int] = set()
    try:
        for part in text.split(","):
            first, _, last = part.partition("-")
            axes.update(range(int(first), int(last or first) + 1))
    except ValueError:
        axes.clear()
    if not axes or max(axes) > AXIS_LIMIT or min(axes) < 0:
        raise RequestRefused("MC511", f"{text!r} names no axes", "such as --axes 0,1,4-6; axes are 0 to 63")
    return sorted(axes)


def axis_of(text: str, info: Info) -> AxisInfo:
    """Return the machine's axis named by its letter (X Y Z A B C are 0 to 5, others are the dialect's), or by
    its number, 9 or [9].

    Raises:
        RequestRefused: MC507 the machine has no such axis.
    """
    letter = AXIS_LETTERS.find(text.upper()) if len(text) == 1 else -1
    digits = text[1:-1] if text[:1] + text[-1:] == "[]" else text
    number = letter if letter >= 0 else int(digits) if digits.isdecimal() else -1
    named = (axis for axis in info.axes if axis.index == number or axis.letter == text.upper() != "")
    found = next(named, None)
    if found is None:
        there = ", ".join(axis_name(axis.index) for axis in info.axes)
        raise RequestRefused("MC507", f"{info.machine} has no axis {text!r}", f"it has {there}")
    return found


def axis_name(index: int) -> str:
    """``X`` for axis 0, the number where there is no letter."""
    return AXIS_LETTERS[index] if index < len(AXIS_LETTERS) else str(index)
