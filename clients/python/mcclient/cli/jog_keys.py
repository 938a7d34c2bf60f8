"""Jogging while a key is held down: a terminal repeats the key, and the axis stops when that ends.

A terminal tells no release of a key. The first press moves the axis for as long as it takes until the
repetition begins; from then on each repetition keeps it moving for a shorter time. Both are the jog's dead
man's time: when the link or this process goes, the axis stops by itself.
"""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import AsyncIterator

from mcclient.cli.options import axis_name
from mcclient.cli.output import say
from mcclient.errors import RequestRefused
from mcclient.machine import Machine
from mcclient.types import AxisInfo

# keyboards begin to repeat after 250 to 660 ms, and then every 20 to 50 ms
FIRST_HOLD_S = 0.7
NEXT_HOLD_S = 0.25
# a call for each repetition would be more than is needed
KEEP_EVERY_S = 0.08
DEFAULT_SHARE = 0.1

FORWARD = frozenset({"+", "=", "\x1b[A", "\x1b[C"})
BACKWARD = frozenset({"-", "_", "\x1b[B", "\x1b[D"})
END = frozenset({"q", "Q", "\x03", "\x04", ""})


async def jog_by_keys(
    machine: Machine, axis: AxisInfo, velocity: float | None, keys: AsyncIterator[str]
) -> None:
    """Move the axis while keys come, until one of `END`.

    Args:
        velocity: [mm/s, deg/s]; None: a tenth of the axis's limit.
        keys: what is typed, a key each.
    """
    speed = abs(velocity) if velocity is not None else DEFAULT_SHARE * axis.max_velocity
    name = axis_name(axis.index)
    speed_text = f"{speed:g} {axis.unit}/s"
    say(f"axis {name}, {speed_text}: hold + or an arrow up or right, - or an arrow down or left; q ends")
    clock = asyncio.get_running_loop().time
    program: str | None = None
    direction = 0
    kept_at = float("-inf")
    async for key in keys:
        wanted = 1 if key in FORWARD else -1 if key in BACKWARD else 0
        if key in END or wanted == 0 or (program is not None and wanted != direction):
            # the other direction, or any other key: stand first
            await _let_go(machine, program)
            program = None
            if key in END:
                return
            if wanted == 0:
                continue
        if program is not None:
            if clock() - kept_at < KEEP_EVERY_S:
                continue
            try:
                await machine.jog(axis.index, velocity=direction * speed, hold_s=NEXT_HOLD_S, program=program)
            except RequestRefused:
                # it had stopped already: the key was let go for longer than the dead man's time
                program = None
        if program is None:
            direction = wanted
            program = await machine.jog(axis.index, velocity=direction * speed, hold_s=FIRST_HOLD_S)
        kept_at = clock()
    await _let_go(machine, program)


async def _let_go(machine: Machine, program: str | None) -> None:
    if program is None:
        return
    try:
        await machine.abort(program)
    except RequestRefused:
        # it stands already
        return


async def from_terminal() -> AsyncIterator[str]:
    """Keys as they are typed, one each, without Enter; the terminal is as before at the end.

    Raises:
        RequestRefused: MC511 standard input is no terminal, or one of Windows.
    """
    if not sys.stdin.isatty() or sys.platform == "win32":
        raise RequestRefused("MC511", "--keys needs a terminal of Linux or macOS", "give a distance instead")
    import termios
    import tty

    handle = sys.stdin.fileno()
    before = termios.tcgetattr(handle)
    loop = asyncio.get_running_loop()
    typed: asyncio.Queue[str] = asyncio.Queue()
    tty.setcbreak(handle)
    loop.add_reader(handle, lambda: typed.put_nowait(os.read(handle, 16).decode("utf-8", "replace")))
    try:
        while True:
            yield await typed.get()
    finally:
        loop.remove_reader(handle)
        termios.tcsetattr(handle, termios.TCSADRAIN, before)
