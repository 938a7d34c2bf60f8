"""Signals that a command's event loop answers, in every operating system."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Callable, Sequence


def on_signals(numbers: Sequence[signal.Signals], act: Callable[[], object]) -> Callable[[], None]:
    """Have the running loop call ``act`` when one of the signals comes; return what ends that.

    Raises:
        ValueError, RuntimeError: not in the main thread.
    """
    loop = asyncio.get_running_loop()
    before = {}
    for number in numbers:
        try:
            loop.add_signal_handler(number, act)
        except NotImplementedError:
            # the event loops of Windows take none
            before[number] = signal.signal(number, lambda *_: loop.call_soon_threadsafe(act))

    def end() -> None:
        for number in numbers:
            if number in before:
                signal.signal(number, before[number])
            else:
                loop.remove_signal_handler(number)

    return end
