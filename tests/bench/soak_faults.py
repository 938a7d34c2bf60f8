"""Programs under random faults for minutes: nothing is lost, nothing runs twice.

``python -m tests.bench.soak_faults --minutes 120 --seed 1`` runs one program after another on a server of its
own with simulated drives, each with a fault at a random moment. Each line moves its axis by one step, so the
axis itself counts: a program that finished has moved it by exactly its lines, one that was broken off by
no more than it had accepted; a server that was killed has to come back and move. The seed and the round that
failed say how to see it again.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import os
import random
import signal
import sys
import tempfile
import time
from collections import Counter
from enum import Enum
from pathlib import Path

from mcclient import Machine, MotionError, Program

from tests.e2e.servers import ServerProcess

STEP_MM = 0.5
MOST_LINES = 400
# of the axis in position [mm]
TOLERANCE_MM = 0.02
ROUND_LIMIT_S = 120.0
BACK_TRIALS = 3
PLANNER_EVERY_S = 40.0


class Fault(Enum):
    """What happens to a program while it runs."""

    NOTHING = "nothing"
    HOLD = "held and resumed"
    OVERRIDE = "override changed"
    ABORT = "aborted"
    STOP = "emergency stop"
    PLANNER = "planner killed"
    SERVER = "server killed"


FINISHES = (Fault.NOTHING, Fault.HOLD, Fault.OVERRIDE)


async def _disturb(fault: Fault, chance: random.Random, server: ServerProcess, machine: Machine) -> None:
    await asyncio.sleep(chance.uniform(0.0, 1.5))
    match fault:
        case Fault.HOLD:
            await machine.hold()
            await asyncio.sleep(chance.uniform(0.0, 0.5))
            await machine.resume()
        case Fault.OVERRIDE:
            await machine.override(chance.choice((20.0, 50.0, 150.0)))
            await asyncio.sleep(chance.uniform(0.0, 0.5))
            await machine.override(100.0)
        case Fault.ABORT:
            await machine.abort()
        case Fault.STOP:
            await machine.estop("soak")
        case Fault.PLANNER:
            for pid in server.planners():
                os.kill(pid, signal.SIGKILL)
        case Fault.SERVER:
            os.kill(server.pid, signal.SIGKILL)
        case Fault.NOTHING:
            return


async def _run(program: Program, lines: int) -> None:
    await program.send_lines(["G1010 P0", "G91 G94 F12000", *[f"G01 X{STEP_MM}"] * lines])
    await program.finish()


async def _back(machine: Machine) -> None:
    """Move the axis to zero; a planner that was killed a moment ago may take the first program with it."""
    for trial in range(BACK_TRIALS):
        try:
            async with machine.program(name="back") as program:
                await program.send_lines(["G1010 P0", "G90 G94 F60000", "G01 X0"])
                await program.finish()
        except MotionError:
            if trial == BACK_TRIALS - 1:
                raise
            await machine.reset()
        else:
            return


async def _round(server: ServerProcess, chance: random.Random, fault: Fault) -> str:
    """Run one program with one fault; return what is wrong, nothing if all agrees."""
    lines = chance.randrange(1, MOST_LINES)
    accepted, finished = 0, False
    async with Machine.connect(server.name, server.endpoint, timeout_s=60.0) as machine:
        before = (await machine.status()).axes.position[0]
        with contextlib.suppress(MotionError):
            async with machine.program(name="soak") as program:
                disturbing = asyncio.create_task(_disturb(fault, chance, server, machine))
                try:
                    await _run(program, lines)
                    finished = True
                finally:
                    accepted = program.accepted_through
                    with contextlib.suppress(MotionError):
                        await disturbing
    if fault is Fault.SERVER:
        server.wait()
        server.start()
    async with Machine.connect(server.name, server.endpoint, timeout_s=60.0) as machine:
        await machine.reset()
        moved = (await machine.status()).axes.position[0] - before
        await _back(machine)
    if fault in FINISHES and not finished:
        return f"a program of {lines} lines did not finish"
    if fault is Fault.SERVER:
        # simulated drives begin anew with the server: all there is to see is that it moves again
        return ""
    wanted = lines * STEP_MM
    if finished and abs(moved - wanted) > TOLERANCE_MM:
        return f"{lines} lines moved the axis by {moved:.3f} mm instead of {wanted:.3f} mm"
    if not -TOLERANCE_MM <= moved <= max(accepted - 2, 0) * STEP_MM + TOLERANCE_MM:
        return f"{accepted} accepted lines moved the axis by {moved:.3f} mm"
    return ""


async def _soak(server: ServerProcess, minutes: float, seed: int) -> int:
    end = time.monotonic() + minutes * 60.0
    rounds: Counter[Fault] = Counter()
    number = 0
    planner_again = 0.0
    while time.monotonic() < end:
        number += 1
        chance = random.Random(f"{seed}/{number}")
        fault = chance.choice(list(Fault))
        if fault is Fault.PLANNER:
            # a server whose planner ends again and again gives up
            if time.monotonic() < planner_again:
                fault = Fault.NOTHING
            else:
                planner_again = time.monotonic() + PLANNER_EVERY_S
        async with asyncio.timeout(ROUND_LIMIT_S):
            wrong = await _round(server, chance, fault)
        if wrong:
            print(f"seed {seed}, round {number}, {fault.value}: {wrong}", flush=True)
            return 1
        rounds[fault] += 1
    for fault in Fault:
        print(f"{rounds[fault]:6} programs: {fault.value}")
    print(f"{number:6} in all, each as it should be")
    return 0


def main() -> int:
    """The exit code: 0 where every round agrees."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--minutes", type=float, default=120.0)
    options.add_argument("--seed", type=int, default=1)
    chosen = options.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        server = ServerProcess(Path(folder), "cartesian", "soak")
        try:
            server.start()
            return asyncio.run(_soak(server, chosen.minutes, chosen.seed))
        except BaseException:
            sys.stderr.write("".join(server.said))
            raise
        finally:
            server.close()


if __name__ == "__main__":
    sys.exit(main())
