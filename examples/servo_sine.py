"""Let an axis follow a sine that this script streams, and show how far behind it stays.

mcserver run, then: python examples/servo_sine.py [--axis 0] [--seconds 4] [--hz 100] [--connect ENDPOINT]
"""

from __future__ import annotations

import argparse
import asyncio

import numpy as np
from mcclient import Machine

AMPLITUDE, FREQUENCY_HZ = 20.0, 0.5  # mm or deg


async def follow(options: argparse.Namespace) -> None:
    """Stream positions and velocities of a sine about where the axis stands."""
    async with Machine.connect(options.machine, options.connect) as machine:
        status = await machine.status()
        start = status.axes.position[status.axes.index.index(options.axis)]
        # a busy computer may be late: the axis stops where nothing comes for so long
        async with machine.servo([options.axis], counts_s=0.5) as servo:
            loop, turn = asyncio.get_running_loop(), 2.0 * np.pi * FREQUENCY_HZ
            begun = loop.time()
            for count in range(round(options.seconds * options.hz)):
                t = count / options.hz
                # from rest: the amplitude grows over the first second
                grown, growing = min(t, 1.0), float(t < 1.0)
                wave, slope = np.sin(turn * t), turn * np.cos(turn * t)
                position = start + AMPLITUDE * grown * wave
                await servo.send([position], [AMPLITUDE * (growing * wave + grown * slope)])
                await asyncio.sleep(max(0.0, begun + (count + 1) / options.hz - loop.time()))
            # at rest
            await servo.send([position])
            counted = (await servo.status()).servo
        print(f"messages: {counted}")  # noqa: T201
        status = await machine.status()
        end = status.axes.position[status.axes.index.index(options.axis)]
        print(f"axis {options.axis} is at {end:.3f}, the last target was {position:.3f}")  # noqa: T201


def main() -> None:
    """Read the options and run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--machine", help="its name, where there are several")
    parser.add_argument("--connect", help="Zenoh endpoint of the server")
    parser.add_argument("--axis", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=4.0)
    parser.add_argument("--hz", type=float, default=100.0)
    asyncio.run(follow(parser.parse_args()))


if __name__ == "__main__":
    main()
