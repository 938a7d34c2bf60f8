"""Python's state of Zenoh's threads, kept from one callback to the next.

A thread that Python has not started gets a thread state for each callback, and loses it at its end. With it
goes the memory of the callback's frames, which is mapped and unmapped each time; unmapping interrupts the
other cores. That takes some 30 µs of a call of 250, so whoever calls back often keeps its state.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")

# a state takes some 20 KB and stays when its thread ends; Zenoh calls back from a handful of lasting threads
KEPT_STATES = 64


class ThreadStates:
    """Keeps the states of the threads that call back; all beyond `KEPT_STATES` do without."""

    def __init__(self) -> None:
        # goes with the state of its thread: what is found there was kept
        self._kept = threading.local()
        self._count = 0

    def keeping(self, callback: Callable[[T], None]) -> Callable[[T], None]:
        """Return the same callback, for threads that keep their state."""
        kept = self._kept

        def call(item: T) -> None:
            try:
                kept.here  # noqa: B018
            except AttributeError:
                self._keep()
            callback(item)

        return call

    def _keep(self) -> None:
        self._kept.here = True
        # other interpreters of Python than CPython have no such states
        ensure = getattr(getattr(ctypes, "pythonapi", None), "PyGILState_Ensure", None)
        if ensure is not None and self._count < KEPT_STATES:
            self._count += 1
            # held once more than it is let go, which is what keeps it
            ensure()
