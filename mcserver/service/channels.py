"""Inputs and outputs for clients: values, who set them, and setting them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TypeVar

from mcserver.errors import Refused
from mcserver.executor.io_bank import NOBODY, OPERATOR, switches_of
from mcserver.machine.io_section import Input, Output
from mcserver.machine.machine_file import Machine
from mcserver.service.executor_port import ExecutorPort, Snapshot
from mcserver.service.reports import InputStatus, OutputStatus

Level = bool | float
Channel = TypeVar("Channel", Input, Output)


class Channels:
    """Inputs and outputs of one machine.

    Args:
        program_in: returns the id of the program in a program slot.
    """

    def __init__(self, machine: Machine, port: ExecutorPort, program_in: Callable[[int], str | None]) -> None:
        self._machine = machine
        self._port = port
        self._program_in = program_in

    def inputs(self, snapshot: Snapshot) -> list[InputStatus]:
        """Return the state of every input in a cycle."""
        return [
            InputStatus(each.name, value, holds=each.holds(value), stops=each.stops(value))
            for each, value in zip(self._machine.inputs, snapshot.inputs, strict=False)
        ]

    def outputs(self, snapshot: Snapshot) -> list[OutputStatus]:
        """Return the state of every output in a cycle."""
        return [
            OutputStatus(each.name, value, self._setter(owner))
            for each, value, owner in zip(
                self._machine.outputs, snapshot.outputs, snapshot.owners, strict=False
            )
        ]

    def holding(self) -> list[str]:
        """Return the names of the inputs that now hold the programs."""
        return self._interlocks(lambda each, value: each.holds(value))

    def switching(self, switch: int | None) -> list[str]:
        """Return the name of the input that now switches on zones, by its index in `Clearance.switches`."""
        if switch is None:
            return []
        column, high = switches_of(self._machine)[switch]
        on = bool(self._port.snapshot().inputs[column]) is high
        return [self._machine.inputs[column].name] if on else []

    def stopping(self) -> list[str]:
        """Return the names of the inputs that now stop the machine."""
        return self._interlocks(lambda each, value: each.stops(value))

    def refuse_interlocked(self, names: Sequence[str], then: str) -> None:
        """Refuse what an interlock forbids.

        Args:
            names: of the inputs that forbid it. then: what to do once they no longer do.

        Raises:
            ServiceError: MC443.
        """
        if names:
            shown = ", ".join(f'"{name}"' for name in names)
            raise Refused(
                "MC443",
                f"the input {shown} does not allow it now",
                f"bring it to where it should be, then {then}",
                inputs=list(names),
            )

    def set_output(self, name: str, value: Level) -> float:
        """Set an output.

        Raises:
            ServiceError: MC445 unknown channel, or a value that it cannot have; MC446 a running program has
                set it, or it is a laser.
        """
        column, output = self._find(self._machine.outputs, name, "output")
        level = _level(output, value)
        if not output.low <= level <= output.high:
            raise Refused(
                "MC445",
                f'{level:g} is outside what the output "{name}" can have',
                f"give {output.low:g} to {output.high:g}",
                name=name,
            )
        if output.laser and level != 0.0:
            raise Refused(
                "MC446",
                f'the laser "{name}" shines only while a program moves along a path',
                "run a program that sets it, such as M3 S10 and a feed move",
                name=name,
            )
        owner = self._port.snapshot().owners
        program = self._program_in(owner[column]) if column < len(owner) else None
        if program is not None:
            raise Refused(
                "MC446",
                f'the output "{name}" is set by the program {program}',
                "abort the program, or wait for its end",
                program=program,
            )
        self._port.orders.set_output(column, level)
        return level

    def set_input(self, name: str, value: Level) -> float:
        """Set a simulated input.

        Raises:
            ServiceError: MC445 unknown channel, or a value that it cannot have; MC446 it is not simulated.
        """
        column, channel = self._find(self._machine.inputs, name, "input")
        level = _level(channel, value)
        if channel.source is not None:
            raise Refused(
                "MC446",
                f'the input "{name}" is real: {channel.source.shown}',
                "only a simulated input can be set",
                name=name,
            )
        self._port.orders.set_input(column, level)
        return level

    def _interlocks(self, test: Callable[[Input, float], bool]) -> list[str]:
        if not self._machine.inputs:
            return []
        values = self._port.snapshot().inputs
        return [
            each.name for each, value in zip(self._machine.inputs, values, strict=False) if test(each, value)
        ]

    def _setter(self, owner: int) -> str:
        if owner == NOBODY:
            return ""
        return "operator" if owner == OPERATOR else self._program_in(owner) or ""

    def _find(self, channels: Sequence[Channel], name: str, kind: str) -> tuple[int, Channel]:
        for column, each in enumerate(channels):
            if each.name == name:
                return column, each
        known = ", ".join(each.name for each in channels) or "none"
        raise Refused("MC445", f"the machine has no {kind} {name!r}", f"it has {known}", name=name)


def _level(channel: Input | Output, value: Level) -> float:
    level = float(value)
    if not math.isfinite(level) or (channel.digital and level not in (0.0, 1.0)):
        what = "a digital one is on or off" if channel.digital else "give a finite number"
        raise Refused("MC445", f"{value!r} is no value of {channel.name!r}", what, name=channel.name)
    return level
