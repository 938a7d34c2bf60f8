"""The planner made ready, with a word to who waits for it."""

from __future__ import annotations

import threading

from mcserver.commands.console import narration

# A start from the cache is over before this [s].
_PATIENCE_S = 3.0


def prepare_planner() -> None:
    """Compiles the planner's loops for this computer, or reads them from the cache."""
    from mcserver.motion.warm_up import warm_up

    told = threading.Timer(
        _PATIENCE_S,
        lambda: narration().print("compiling the planner for this computer: once, some 20 seconds …"),
    )
    told.daemon = True
    told.start()
    try:
        warm_up()
    finally:
        told.cancel()
