"""Lead the tool of an arm round a circle by poses that this script streams.

mcserver run --machine arm6, then: python examples/servo_circle.py [--radius 80] [--seconds 4] [--hz 100]
"""

from __future__ import annotations

import argparse
import asyncio

import numpy as np
from mcclient import Machine

TOOL = 1


async def lead(options: argparse.Namespace) -> None:
    """Stream poses of a circle in Y and Z through where the tool is, each passed at a twist."""
    async with Machine.connect(options.machine, options.connect) as machine:
        (tool,) = [each for each in (await machine.status()).tools if each.number == TOOL]
        start = np.array([*tool.position, *tool.orientation])
        # a busy computer may be late: the axes stop where nothing comes for so long
        async with machine.servo(counts_s=0.5) as servo:
            loop = asyncio.get_running_loop()
            begun, turn = loop.time(), 2.0 * np.pi / options.seconds
            for count in range(round(options.seconds * options.hz) + 1):
                t = count / options.hz
                # from rest to rest: the angle goes as t - sin t does
                angle = turn * t - np.sin(turn * t)
                rate = turn * (1.0 - np.cos(turn * t))
                pose, twist = start.copy(), np.zeros(6)
                pose[1:3] += options.radius * np.array([np.sin(angle), 1.0 - np.cos(angle)])
                twist[1:3] = options.radius * rate * np.array([np.cos(angle), np.sin(angle)])
                await servo.send(pose, twist, tool=TOOL)
                await asyncio.sleep(max(0.0, begun + (count + 1) / options.hz - loop.time()))
            counted = (await servo.status()).servo
        print(f"messages: {counted}")  # noqa: T201
        (tool,) = [each for each in (await machine.status()).tools if each.number == TOOL]
        missed = np.linalg.norm(np.array(tool.position) - start[:3])
        print(f"tool {TOOL} is {missed:.3f} mm from where it began")  # noqa: T201


def main() -> None:
    """Read the options and run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--machine", help="its name, where there are several")
    parser.add_argument("--connect", help="Zenoh endpoint of the server")
    parser.add_argument("--radius", type=float, default=80.0, help="[mm]")
    parser.add_argument("--seconds", type=float, default=4.0, help="of the whole circle")
    parser.add_argument("--hz", type=float, default=100.0)
    asyncio.run(lead(parser.parse_args()))


if __name__ == "__main__":
    main()
