"""Child processes, and the heap of a process that runs for long."""

from __future__ import annotations

import contextlib
import gc
import logging
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence

import msgspec

from mcserver.terminal import LogFormatter

# New objects between two runs of the collector: few pauses, and cycles of garbage are rare.
YOUNG_OBJECTS = 20_000
# where the system sets no limit
MANY_FILES = 1_000_000


def start_child(
    module: str, start: msgspec.Struct, descriptors: Sequence[int], variables: Mapping[str, str] | None = None
) -> subprocess.Popen[bytes]:
    """Start ``python -m module`` with ``start`` as MessagePack on its standard input.

    It has nothing of this process in it but its environment, with ``variables``, and the file
    ``descriptors``, under the same numbers.
    """
    environment = {**os.environ, **(variables or {})}
    environment["PYTHONPATH"] = os.pathsep.join(path or os.getcwd() for path in sys.path)
    # matrices are small; a thread of BLAS for each core only takes memory
    environment.setdefault("OPENBLAS_NUM_THREADS", "1")
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


def raise_file_limit() -> int:
    """Allow this process as many open files as it may have, and return how many."""
    if sys.platform == "win32":
        return MANY_FILES
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    with contextlib.suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
        soft = hard
    return soft if soft >= 0 else MANY_FILES


def freeze_heap() -> None:
    """Exempt what is on the heap now from garbage collection, and collect seldom.

    For a process that runs for long and makes thousands of values a second.
    """
    gc.freeze()
    collect_seldom()


def collect_seldom() -> None:
    """Collect garbage seldom: for a process that ends soon, and clears its heap in order then."""
    gc.set_threshold(YOUNG_OBJECTS, 10, 10)


def log_to_stderr(level: int, form: str = "%(message)s") -> None:
    """Write the log of this process to standard error."""
    handler = logging.StreamHandler()
    handler.setFormatter(LogFormatter(form))
    logging.basicConfig(level=level, handlers=[handler], force=True)
