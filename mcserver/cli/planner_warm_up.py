"""The planner made ready, with a word to who waits for it."""

from __future__ import annotations

import threading

from mcserver.cli.console import narration
from mcserver.motion.compiling import COMPILING, PATIENCE_S


def prepare_planner() -> None:
    """Compiles the planner's loops for this computer, or reads them from the cache."""
    from mcserver.motion.warm_up import warm_up

    told = threading.Timer(
        PATIENCE_S,
        lambda: narration().print(COMPILING),
    )
    told.daemon = True
    told.start()
    try:
        warm_up()
    finally:
        told.cancel()
