"""Checks and simulations of whole programs, in a process of their own.

They compute for seconds and would hold the interpreter's lock all that time; the service beside them has
to go on.
"""

from __future__ import annotations

import asyncio
import importlib
import multiprocessing
import multiprocessing.connection
import os
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any, TypeVar

from mcserver.errors import Diagnostic, Refused
from mcserver.machine.machine_file import Machine

T = TypeVar("T")

WAITING = 4
LIMIT_S = 300.0


class ProgramChecker:
    """One worker process, started when it is first needed; a few requests wait for it in order.

    Args:
        machine: what programs are checked against.
    """

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._pool: ProcessPoolExecutor | None = None
        self._under_way = 0

    async def check(self, text: str, positions: dict[int, float] | None) -> list[Diagnostic]:
        """Every fault of a text; ``positions`` [m or rad] by axis number.

        Raises:
            ServiceError: MC508 too many wait; MC523 it took longer than `LIMIT_S`, or the worker died.
        """
        return await self._run(check_text, text, self._machine, positions)

    async def simulate(self, text: str) -> dict[str, Any]:
        """The object of ``mcserver simulate --json``. Raises as `check`."""
        return await self._run(simulate_text, text, self._machine)

    def close(self) -> None:
        """Ends the worker, whatever it is at."""
        pool, self._pool = self._pool, None
        if pool is not None:
            # its processes are private to the pool, and it has no public way to end one that computes
            for process in list((getattr(pool, "_processes", None) or {}).values()):
                process.terminate()
            pool.shutdown(wait=False, cancel_futures=True)

    async def _run(self, function: Callable[..., T], *arguments: object) -> T:
        if self._under_way > WAITING:
            raise Refused(
                "MC508", f"{WAITING} checks and simulations wait", "send it again later", limit=WAITING
            )
        self._under_way += 1
        try:
            if self._pool is None:
                self._pool = ProcessPoolExecutor(
                    1, mp_context=multiprocessing.get_context("spawn"), initializer=end_with_parent
                )
            loop = asyncio.get_running_loop()
            async with asyncio.timeout(LIMIT_S):
                return await loop.run_in_executor(self._pool, function, *arguments)
        except (TimeoutError, BrokenProcessPool) as error:
            self.close()
            raise Refused(
                "MC523",
                f"the program took longer than {LIMIT_S:.0f} s"
                if isinstance(error, TimeoutError)
                else "the worker process died",
                "use `mcserver check` or `mcserver simulate` on the command line",
            ) from error
        finally:
            self._under_way -= 1


def end_with_parent() -> None:
    """Lets this worker end when the server was killed: nobody would ever tell it to."""
    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def watch() -> None:
        multiprocessing.connection.wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def check_text(text: str, machine: Machine, positions: Mapping[int, float] | None) -> list[Diagnostic]:
    """`mcserver.gcode.program_check.check_program` with the machine's kinematics; runs in the worker."""
    from mcserver.gcode.program_check import check_program
    from mcserver.machine.machine_kinematics import build_kinematics

    return check_program(text, machine, build_kinematics(machine), positions=positions)


def simulate_text(text: str, machine: Machine) -> dict[str, Any]:
    """`mcserver.simulation.simulation.simulate`, its report; runs in the worker."""
    simulation = importlib.import_module("mcserver.simulation.simulation")
    kinematics = importlib.import_module("mcserver.machine.machine_kinematics").build_kinematics(machine)
    report: dict[str, Any] = simulation.simulate(text, machine, kinematics=kinematics).report
    return report
