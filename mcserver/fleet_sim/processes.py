"""A fleet over several processes: each has its share of the machines, and ends with who started it."""

from __future__ import annotations

import itertools
import multiprocessing
import signal
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection

import msgspec

from mcserver.errors import McError, RuntimeFault
from mcserver.fleet_sim.fleet import FleetOptions, open_fleet

START_LIMIT_S = 120.0
STOP_LIMIT_S = 5.0


def shares(options: FleetOptions, processes: int) -> list[FleetOptions]:
    """Divide the machines among processes, as evenly as it goes; none without a machine."""
    count = min(processes, options.machines)
    bounds = [options.machines * part // count for part in range(count + 1)]
    return [
        msgspec.structs.replace(options, first=options.first + begin, machines=end - begin)
        for begin, end in itertools.pairwise(bounds)
    ]


def run_fleet(
    options: FleetOptions, processes: int, stopping: threading.Event, on_ready: Callable[[], None]
) -> None:
    """Run until ``stopping`` is set.

    Raises:
        McError: MC075 a process cannot reach its network, MC076 one has ended by itself.
    """
    context = multiprocessing.get_context("spawn")
    started = []
    for share in shares(options, processes):
        ours, theirs = context.Pipe()
        process = context.Process(target=_serve, args=(msgspec.msgpack.encode(share), theirs), daemon=True)
        process.start()
        theirs.close()
        started.append((process, ours))
    try:
        for _, pipe in started:
            _await_ready(pipe)
        on_ready()
        while not stopping.wait(0.2):
            if any(not process.is_alive() for process, _ in started):
                raise RuntimeFault(
                    "MC076", "a process of the fleet has ended", "see what it wrote to standard error"
                )
    finally:
        for _, pipe in started:
            pipe.close()
        for process, _ in started:
            process.join(STOP_LIMIT_S)
            if process.is_alive():
                process.kill()


def _await_ready(pipe: Connection) -> None:
    try:
        refusal = (
            pipe.recv()
            if pipe.poll(START_LIMIT_S)
            else ("MC076", "a process of the fleet does not start", "")
        )
    except EOFError:
        refusal = ("MC076", "a process of the fleet has ended", "see what it wrote to standard error")
    if refusal is not None:
        raise RuntimeFault(*refusal)


def _serve(written: bytes, pipe: Connection) -> None:
    # the parent ends it, by closing the pipe or by being gone
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    options = msgspec.msgpack.decode(written, type=FleetOptions)
    try:
        session, fleet = open_fleet(options)
    except McError as error:
        pipe.send((error.code, error.message, error.hint))
        return

    def until_closed() -> None:
        try:
            pipe.recv()
        except EOFError:
            fleet.stop()

    pipe.send(None)
    threading.Thread(target=until_closed, daemon=True).start()
    fleet.run()
    session.close()  # type: ignore[no-untyped-call]
    fleet.close()
