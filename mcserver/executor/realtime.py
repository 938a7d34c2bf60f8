"""Realtime features of Linux for the cycle's thread; each refusal is reported, none is fatal."""

from __future__ import annotations

import ctypes
import errno
import mmap
import os
import time
from pathlib import Path

PRIORITY = 80

_MCL_CURRENT_AND_FUTURE = 3
# Libraries that no cycle calls, LLVM and numpy's BLAS, by the beginnings of their file names.
_NOT_IN_A_CYCLE = ("libllvmlite", "libscipy_openblas")
_TIMER_ABSTIME = 1


class _Timespec(ctypes.Structure):
    _fields_ = (("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long))


class MonotonicClock:
    """CLOCK_MONOTONIC, with sleep to an absolute deadline (clock_nanosleep, TIMER_ABSTIME)."""

    def __init__(self) -> None:
        self._sleep = ctypes.CDLL(None, use_errno=True).clock_nanosleep
        self._sleep.argtypes = (ctypes.c_int, ctypes.c_int, ctypes.POINTER(_Timespec), ctypes.c_void_p)
        self._sleep.restype = ctypes.c_int
        self._deadline = _Timespec()
        self._pointer = ctypes.pointer(self._deadline)

    def now(self) -> int:
        """Return the time [ns]."""
        return time.clock_gettime_ns(time.CLOCK_MONOTONIC)

    def sleep_until(self, deadline: int) -> None:
        """Return at or after ``deadline`` [ns], not before, signals or not."""
        self._deadline.seconds, self._deadline.nanoseconds = divmod(deadline, 1_000_000_000)
        while self._sleep(time.CLOCK_MONOTONIC, _TIMER_ABSTIME, self._pointer, None) == errno.EINTR:
            pass


def take_realtime_priority() -> bool:
    """Put this thread under SCHED_FIFO; False without the right to."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except OSError:
        return False
    return True


def lock_memory() -> bool:
    """Lock all present and future pages of this process in memory; return False without the right to.

    Libraries that no cycle calls are left out: 150 MB of the compiler, once kernels are compiled, and 24 MB
    of BLAS.
    """
    locked: int = ctypes.CDLL(None, use_errno=True).mlockall(_MCL_CURRENT_AND_FUTURE)
    release_libraries(*_NOT_IN_A_CYCLE)
    return locked == 0


def release_libraries(*names: str) -> None:
    """Unlock and drop the pages of libraries, by the beginnings of their file names.

    A call reads them again. Pages that were written to, as by the linker, stay: no file holds them.
    """
    system = ctypes.CDLL(None, use_errno=True)
    start = end = 0
    for line in Path("/proc/self/smaps").read_text().splitlines():
        first, *rest = line.split()
        if first == "Anonymous:" and rest[0] == "0" and start:
            place = ctypes.c_void_p(start), ctypes.c_size_t(end - start)
            system.munlock(*place)
            system.madvise(*place, mmap.MADV_DONTNEED)
        elif not first.endswith(":"):
            start, end = (int(each, 16) for each in first.split("-"))
            if not Path(rest[-1]).name.startswith(names):
                start = 0
