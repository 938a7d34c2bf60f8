"""Clients that each stream a program of short moves of one axis, until the input closes."""

from __future__ import annotations

import asyncio
import sys

from mcclient import Machine, MotionError

CHUNK = 20
PERIOD_S = 0.2


async def stream(endpoint: str, machine: str, axis: int) -> None:
    """Move one axis to and fro, a hundred lines a second."""
    async with (
        Machine.connect(machine, endpoint, timeout_s=30.0) as reached,
        reached.program(axes=[axis]) as program,
    ):
        await program.send_lines([f"G1010 P{axis}", "G91 G94 F6000"])
        while True:
            await program.send_lines([f"G01 [{axis}]1", f"G01 [{axis}]-1"] * (CHUNK // 2))
            await asyncio.sleep(PERIOD_S)


async def main(endpoint: str, machine: str, count: int) -> None:
    """Stream from as many sessions."""
    tasks = [asyncio.create_task(stream(endpoint, machine, axis)) for axis in range(count)]
    await asyncio.sleep(2.0)
    failed = [task for task in tasks if task.done()]
    print("ready" if not failed else f"failed: {failed[0].exception()}", flush=True)
    await asyncio.to_thread(sys.stdin.read)
    for task in tasks:
        task.cancel()
    for ended in await asyncio.gather(*tasks, return_exceptions=True):
        if isinstance(ended, MotionError):
            print(ended, file=sys.stderr)


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1], sys.argv[2], int(sys.argv[3])))
