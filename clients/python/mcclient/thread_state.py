"""Python's state of Zenoh's threads, kept from one callback to the next.

Python makes a state for each callback in a thread that it has not started, and takes it away at the end, some
30 µs with the memory that goes with it: as long as all else that a reply costs here.
"""

from __future__ import annotations

import ctypes
import threading

# a state takes some 20 KB and stays when its thread ends; a session calls back from a handful of threads
KEPT_STATES = 64


class ThreadStates:
    """Keeps the states of the threads that call `keep`; all beyond `KEPT_STATES` do without."""

    def __init__(self) -> None:
        # goes with the state of its thread: what is found there was kept
        self._kept = threading.local()
        self._count = 0

    def keep(self) -> None:
        """Keep the state of the calling thread; to be called first in a callback."""
        try:
            self._kept.here  # noqa: B018
        except AttributeError:
            self._kept.here = True
            # other interpreters of Python than CPython have no such states
            ensure = getattr(getattr(ctypes, "pythonapi", None), "PyGILState_Ensure", None)
            if ensure is not None and self._count < KEPT_STATES:
                self._count += 1
                # held once more than it is let go, which is what keeps it
                ensure()
