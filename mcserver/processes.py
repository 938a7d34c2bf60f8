"""Child processes, and the heap of a process that runs for long."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
from collections.abc import Sequence

import msgspec

# New objects between two looks of the collector.
YOUNG_OBJECTS = 20_000


def start_child(module: str, start: msgspec.Struct, descriptors: Sequence[int]) -> subprocess.Popen[bytes]:
    """Starts ``python -m module`` with ``start`` as MessagePack on its standard input.

    It has nothing of this process in it but the file ``descriptors``, under the same numbers.
    """
    environment = dict(os.environ, PYTHONPATH=os.pathsep.join(path or os.getcwd() for path in sys.path))
    process = subprocess.Popen(
        [sys.executable, "-m", module], stdin=subprocess.PIPE, pass_fds=tuple(descriptors), env=environment
    )
    assert process.stdin is not None
    try:
        with process.stdin as stdin:
            stdin.write(msgspec.msgpack.encode(start))
    except BrokenPipeError:
        # it ended before it read; its exit code tells
        pass
    return process


def settle_collector() -> None:
    """What is here now stays: thousands of values a second need not look through it again."""
    gc.freeze()
    gc.set_threshold(YOUNG_OBJECTS, 10, 10)
