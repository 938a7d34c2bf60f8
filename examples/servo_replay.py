"""Replay a recording: stream its setpoints to the axes that it has, as chunks, at its own speed or slower.

mcctl record --output path.npz (or mcserver simulate part.gcode --output path.npz), then:
python examples/servo_replay.py path.npz [--axes 0,1] [--speed 0.5] [--connect ENDPOINT]

The axes go to where the recording begins first. What their limits do not let them follow is caught up with.
"""

from __future__ import annotations

import argparse
import asyncio

import numpy as np
from mcclient import Machine, Servo
from numpy.typing import NDArray

Array = NDArray[np.float64]

# A message every 50 ms has the points of the next 0.3 s: the network may be late by as much.
PERIOD_S, AHEAD_S, POINT_S = 0.05, 0.3, 0.02
# messages between two looks whether the axes stand at the beginning
LOOK = 4


async def go_to(machine: Machine, servo: Servo, start: Array) -> None:
    """Let the axes come to rest where the recording begins, or at the end of their travel before it."""
    before: list[float] = []
    while True:
        for _ in range(LOOK):
            await servo.send(start)
            await asyncio.sleep(PERIOD_S)
        axes = (await machine.status()).axes
        places = [axes.setpoint[axes.index.index(axis)] for axis in servo.axes]
        if places == before or np.allclose(places, start, atol=1e-6):
            return
        before = places


async def replay(options: argparse.Namespace) -> None:
    """Read the file and stream it."""
    with np.load(options.file) as recording:
        recorded = [int(axis) for axis in recording["axes"]]
        axes = [int(axis) for axis in options.axes.split(",")] if options.axes else sorted(recorded)
        times = (recording["time_s"] - recording["time_s"][0]) / options.speed
        places = recording["setpoint"][:, [recorded.index(axis) for axis in axes]]

    def at(t: Array) -> Array:
        return np.column_stack([np.interp(t, times, column) for column in places.T])

    async with (
        Machine.connect(options.machine, options.connect) as machine,
        machine.servo(axes, name=f"replay of {options.file}", counts_s=1.0) as servo,
    ):
        await go_to(machine, servo, places[0])
        loop = asyncio.get_running_loop()
        begun, ahead = loop.time(), np.arange(POINT_S, AHEAD_S, POINT_S)
        while (now := loop.time() - begun) < times[-1]:
            await servo.send(at(now + ahead), times=ahead)
            await asyncio.sleep(PERIOD_S)
        await servo.send(places[-1])
        counted = (await servo.status()).servo
        await servo.close()
        print(f"messages: {counted}")  # noqa: T201
        found = (await machine.status()).axes
        for axis, place in zip(axes, places[-1], strict=True):
            at_end = found.setpoint[found.index.index(axis)]
            print(f"axis {axis} is at {at_end:.3f}, the recording ends at {place:.3f}")  # noqa: T201


def main() -> None:
    """Read the options and run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", help="an .npz with time_s, axes and setpoint")
    parser.add_argument("--machine", help="its name, where there are several")
    parser.add_argument("--connect", help="Zenoh endpoint of the server")
    parser.add_argument("--axes", help="of the recording: 0,1; all without it")
    parser.add_argument("--speed", type=float, default=1.0, help="1: as recorded")
    asyncio.run(replay(parser.parse_args()))


if __name__ == "__main__":
    main()
