"""A process of our own: a fresh interpreter that runs one module, told on standard input what it is for."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence

import msgspec


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
