"""``python -m tests.e2e_can.faults``: each fault of a CAN drive in a moving group, and what came of it.

A real server, simulated drives and the buses between them run as processes of their own. Three axes move
together at 100 mm/s; then one drive, or its bus, is disturbed. The table that is printed counts cycles from
the first one in which the disturbance can be seen in the bus's frames. It is docs/canopen-faults.md's.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import sys
import tempfile
from collections.abc import AsyncIterator, Sequence
from pathlib import Path

import numpy as np
from mcclient import ProgramFaulted

from tests.e2e.conftest import connected
from tests.e2e.observing import run
from tests.e2e_can.bench import (
    AXES,
    CYCLE_HZ,
    END,
    ENERGIZE,
    GROUP,
    LATCH_S,
    LIMIT_S,
    NODE,
    START,
    VICTIM,
    Bench,
)
from tests.e2e_can.bus_log import BusLog
from tests.e2e_can.cell import running
from tests.e2e_can.cycles import rows_of
from tests.e2e_can.disturbances import SILENCE_CYCLES, Disturbance, disturbances, disturbances_of_modes
from tests.e2e_can.machines import INCREMENTS, PATIENT, SCREW_MM, Raw, buses, in_mode, slides
from tests.e2e_can.outcome import Outcome, greatest_jump, measure_stop, table
from tests.e2e_can.signs import Evidence, Witness

PER_MM = INCREMENTS / SCREW_MM
# a drive is off some cycles after G1001 [s of the executor]
OFF_S = 0.2
# the first axis shares the victim's bus
SHARING = Witness(0, 1, 0, PER_MM)


@contextlib.asynccontextmanager
async def bench(
    cycle_hz: float = CYCLE_HZ, interfaces: Sequence[str] = (), *, patient: bool = False, mode: str = "csp"
) -> AsyncIterator[Bench]:
    """Two buses: with a hub each, and the victim's drive in a process of its own, or on interfaces.

    Args:
        mode: of the victim's drive.
        patient: drives and processes may be late, as in an emulated machine; else the usual times hold.
    """

    def machine_on(addresses: Sequence[str]) -> Raw:
        raw = slides(addresses, cycle_hz, AXES)
        if mode != "csp":
            in_mode(raw, VICTIM, mode)
        if patient:
            return raw
        for axis in raw["axis"]:
            axis["drive"] = {key: value for key, value in axis["drive"].items() if key not in PATIENT}
        return {**raw, "bus": buses(addresses, SILENCE_CYCLES)}

    nodes = range(1, AXES + 1)
    # an emulated machine takes half a minute to start a process
    processes = [nodes] if interfaces else [[node for node in nodes if node != NODE], [NODE]]
    with (
        tempfile.TemporaryDirectory() as folder,
        running(
            Path(folder),
            machine_on,
            interfaces=interfaces,
            channels=2,
            hubs=2,
            processes=processes,
        ) as cell,
    ):
        log = BusLog(cell.addresses)
        try:
            async with connected(cell.server) as machine:
                made = Bench(cell, machine, log, mode)
                keeping = asyncio.create_task(made.keep_events())
                try:
                    yield made
                finally:
                    keeping.cancel()
                    await asyncio.gather(keeping, return_exceptions=True)
        finally:
            log.close()


async def disturb(made: Bench, disturbance: Disturbance) -> Outcome:
    """One row of the table."""
    if disturbance.sign is None:
        return await pass_over(made, disturbance)
    begin, seen = made.log.length, len(made.events)
    others = tuple(axis for axis in GROUP if axis not in disturbance.concerned)
    async with made.moving() as moving:
        if disturbance.at_rest:
            await moving.program.finish()
            await run(made.machine, ["G1001"], list(GROUP))
            await made.later(OFF_S)
        injected = made.log.length
        await asyncio.to_thread(disturbance.inject, made.cell)
        if disturbance.meanwhile is not None:
            await disturbance.meanwhile(made.machine)
        with contextlib.suppress(ProgramFaulted):
            if disturbance.at_rest:
                await run(made.machine, [ENERGIZE], list(GROUP))
            else:
                async with asyncio.timeout(LIMIT_S):
                    await moving.program.finish()
        event = await made.until_event(seen, "fault")
        await made.until("at rest", axes=others)
        await made.later(0.1)
        frames = made.log.frames(begin)
    assert event.fault is not None
    rows = rows_of(moving.recording.blocks)
    visible = disturbance.sign.row(Evidence(frames, injected - begin, rows, SHARING))
    stop = measure_stop(rows, visible, event.fault.t, others)
    await asyncio.to_thread(disturbance.undo, made.cell)
    if disturbance.afterwards is not None:
        await disturbance.afterwards(made.machine)
    if disturbance.returns:
        await made.until_event(seen, disturbance.returns)
    latched = (await made.later(LATCH_S)).axes.state[VICTIM] == "fault"
    latch = await made.refused_without_reset() if latched else ""
    before = made.log.length
    recovered = await made.recover()
    return Outcome(
        disturbance.name,
        event.fault.code,
        event.fault.axis,
        event.fault.line,
        event.fault.message,
        stop.reported,
        None if disturbance.at_rest else stop.braked,
        None if disturbance.at_rest else stop.rested,
        latch,
        recovered,
        greatest_jump(
            made.log.frames(before),
            [axis + 1 for axis in disturbance.concerned],
            NODE if made.mode == "cst" else None,
        ),
    )


async def pass_over(made: Bench, disturbance: Disturbance) -> Outcome:
    """A row of what stops nothing: the motion ends where it was to end."""
    message = ""
    async with made.moving() as moving:
        await asyncio.to_thread(disturbance.inject, made.cell)
        if disturbance.meanwhile is not None:
            message = await disturbance.meanwhile(made.machine)
        async with asyncio.timeout(LIMIT_S):
            await moving.program.finish()
        status = await made.until("at rest")
    await asyncio.to_thread(disturbance.undo, made.cell)
    there = np.abs(np.array(status.axes.setpoint[: len(END)]) - END).max() < 1e-3
    return Outcome(disturbance.name, message, recovered=bool(there))


async def measure(
    chosen: Sequence[Disturbance], repeat: int = 1, cycle_hz: float = CYCLE_HZ
) -> list[Outcome]:
    """The rows of some disturbances, one after the other on one server for each mode."""
    outcomes = []
    for mode in dict.fromkeys(disturbance.mode for disturbance in chosen):
        async with bench(cycle_hz, mode=mode) as made:
            await run(made.machine, START, list(GROUP))
            for disturbance in [each for each in chosen if each.mode == mode] * repeat:
                outcome = await disturb(made, disturbance)
                sys.stderr.write(f"{disturbance.name}: {outcome.message or 'motion ended well'}\n")
                outcomes.append(outcome)
    return outcomes


def main() -> int:
    """Prints the table; the exit code says whether every axis came back without a jump."""
    options = argparse.ArgumentParser(prog="python -m tests.e2e_can.faults", description=__doc__)
    options.add_argument("--repeat", type=int, default=1, metavar="N")
    options.add_argument("names", nargs="*", help="of disturbances; all without any")
    given = options.parse_args()
    chosen = [
        each
        for each in (*disturbances(), *disturbances_of_modes())
        if not given.names or each.name in given.names
    ]
    outcomes = asyncio.run(measure(chosen, given.repeat))
    sys.stdout.write(table(outcomes) + "\n")
    return 0 if all(each.recovered and not each.jump for each in outcomes) else 1


if __name__ == "__main__":
    sys.exit(main())
