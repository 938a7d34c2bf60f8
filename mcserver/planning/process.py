"""The planner's process: ``python -m mcserver.planning.process``, with its machine on standard input.

It plans, so that the service's loop has an interpreter of its own. Its main thread takes orders, the
planner's thread plans and tells what happened. It ends with the server, whose end of the connection closes.
"""

from __future__ import annotations

import gc
import os
import signal
import sys
from multiprocessing.connection import Connection

import msgspec

from mcserver.executor.shm.shared_memory import map_block
from mcserver.motion.warm_up import warm_up
from mcserver.planning.pipeline_factory import PipelineFactory
from mcserver.planning.planner_messages import Orders, Outcome, PlannerStart
from mcserver.planning.planner_port import SharedPlannerPort
from mcserver.planning.planner_thread import PlannerThread
from mcserver.processes import settle_collector

NICE = 5
# At least this often the server hears that the planner is at work [s].
PULSE_S = 0.5


def main() -> int:
    """Runs until the server says that there is no more, or is gone."""
    start = msgspec.msgpack.decode(sys.stdin.buffer.read(), type=PlannerStart)
    # it is the server that ends this process, in order
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    connection: Connection = Connection(start.connection)
    parts = map_block(start.memory, start.machine, start.slots)
    os.close(start.memory)
    warm_up()
    # it works ahead of the motion and can wait a moment; whoever calls the server is waiting now
    os.nice(NICE)
    encode = msgspec.msgpack.Encoder().encode

    def deliver(outcomes: list[Outcome]) -> None:
        try:
            connection.send_bytes(encode(outcomes))
        except OSError:
            # nobody is left to hear it; the main thread ends the process
            return

    port = SharedPlannerPort(start.machine, parts)
    planner = PlannerThread(port, PipelineFactory(start.machine, port), deliver, pulse_s=PULSE_S)
    gc.collect()
    settle_collector()
    deliver([])
    take_orders(connection, planner)
    return 0


def take_orders(connection: Connection, planner: PlannerThread) -> None:
    """Hands orders to the planner until an empty one comes or the connection closes."""
    decoder = msgspec.msgpack.Decoder(Orders)
    planner.start()
    try:
        while order := connection.recv_bytes():
            planner.order(decoder.decode(order))
    except (EOFError, OSError):
        return
    finally:
        planner.stop()


if __name__ == "__main__":
    sys.exit(main())
