"""The conformance program of the Python SDK; says as JSON, one object a line, what came of it.

main.py ENDPOINT TOKEN stream FILE [PROGRAM] | cancel FILE | watch ROWS | jog AXIS VELOCITY MS | estop |
bench FILE

ENDPOINT is Zenoh's; the token is not used.
"""

from __future__ import annotations

import asyncio
import json
import statistics
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from mcclient import Machine, MotionError
from mcclient.errors import ProgramError
from mcclient.types import Continuation

# a server that is killed needs so long at most to be there again
PATIENCE_S = 120.0
KEEP_S = 0.1
# that of a machine beside a person is shorter; a computer that also runs the server is late now and then
HOLD_S = 2.0
STATUS_CALLS = 300
BENCH_S = 3.0


def say(**values: object) -> None:
    sys.stdout.write(json.dumps(values) + "\n")
    sys.stdout.flush()


def lines_of(file: str, start: int = 1) -> Iterator[str]:
    with Path(file).open(encoding="utf-8") as lines:
        for number, line in enumerate(lines, 1):
            if number >= start:
                yield line.rstrip("\n")


def show(shown: Continuation) -> None:
    say(continuation={"line": shown.line, "done": shown.done, "axes": len(shown.axes)})


async def stream(machine: Machine, file: str, former: str = "") -> None:
    opened = (
        machine.continue_program(former, way=True, on_disconnect="finish", show=show)
        if former
        else machine.program(file, on_disconnect="finish")
    )
    program = await opened
    try:
        say(program=program.id)
        # where it goes on, the server has the first of them already, or all
        rest = list(lines_of(file, program.given_through + 1))
        if rest:
            await program.send_lines(rest)
        result = await program.finish()
    finally:
        await program.leave()
    say(state=result.state, accepted=result.accepted, done=result.done)


async def cancel(machine: Machine, file: str) -> None:
    """Stream a file over and over, give that up in the middle, and go on with one line."""
    lines, fed = list(lines_of(file)), 0

    def endless() -> Iterator[str]:
        nonlocal fed
        while True:
            fed += 1
            yield lines[min(fed, len(lines)) - 1]

    program = await machine.program()
    streaming = asyncio.create_task(program.send_lines(endless()))
    await program.wait_done(len(lines))
    streaming.cancel()
    await asyncio.wait([streaming])
    following = (await program.send(lines[-1])).number
    before = fed
    result = await program.finish()
    later = fed - before
    say(next=following, fed=before, fed_later=later, accepted=result.accepted, done=result.done)


async def watch(machine: Machine, rows: str) -> None:
    seen, following, gaps, axes = 0, -1, 0, 0
    async for samples in machine.samples():
        gaps += following >= 0 and samples.seq != following
        following = samples.seq + len(samples.time_s)
        seen += len(samples.time_s)
        axes = len(samples.axes)
        if seen >= int(rows):
            break
    say(rows=seen, gaps=gaps, axes=axes)


async def jog(machine: Machine, axis: str, velocity: str, duration_ms: str) -> None:
    until = time.monotonic() + int(duration_ms) / 1000.0
    program = await machine.jog(int(axis), velocity=float(velocity), hold_s=HOLD_S)
    while (left := until - time.monotonic()) > 0:
        await asyncio.sleep(min(KEEP_S, left))
        await machine.jog(int(axis), velocity=float(velocity), hold_s=HOLD_S, program=program)
    await machine.abort(program)
    say(ok=True)


async def estop(machine: Machine) -> None:
    await machine.estop("conformance")
    say(state=(await machine.status()).state)


async def bench(machine: Machine, file: str) -> None:
    program = await machine.program()
    begun = time.perf_counter()
    count = await program.send_lines(lines_of(file))
    streamed = time.perf_counter() - begun
    await program.finish()
    await program.leave()
    latencies = []
    for _ in range(STATUS_CALLS):
        begun = time.perf_counter()
        await machine.status()
        latencies.append(time.perf_counter() - begun)
    frames = rows = 0
    begun = time.perf_counter()
    async for samples in machine.samples():
        frames += 1
        rows += len(samples.time_s)
        if time.perf_counter() - begun > BENCH_S:
            break
    took = time.perf_counter() - begun
    say(
        lines_per_s=count / streamed,
        status_p50_ms=1e3 * statistics.median(latencies),
        frames_per_s=frames / took,
        rows_per_s=rows / took,
    )


TASKS = {task.__name__: task for task in (stream, cancel, watch, jog, estop, bench)}


async def main(endpoint: str, _token: str, task: str, *arguments: str) -> int:
    try:
        async with Machine.connect(connect=endpoint, patience_s=PATIENCE_S) as machine:
            await TASKS[task](machine, *arguments)
    except MotionError as error:
        found = [
            {"code": each.code, "line": each.line, "column": each.column, "message": each.message}
            for each in error.diagnostics
        ]
        ended = {"accepted": error.accepted, "done": error.done} if isinstance(error, ProgramError) else {}
        say(code=error.code, message=error.message, hint=error.hint, diagnostics=found, **ended)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(asyncio.run(main(*sys.argv[1:])))
