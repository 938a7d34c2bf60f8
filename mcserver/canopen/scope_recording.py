"""A scope fed from a bus that is listened to beside its master."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from mcserver.can.cob import SYNC
from mcserver.can.port import ListeningPort
from mcserver.canopen.bus_frames import frames_of
from mcserver.canopen.scope import Scope
from mcserver.canopen.settings import DriveSettings
from mcserver.errors import RuntimeFault

# Without a SYNC for so long no cycle runs.
NO_SYNC_S = 2.0


def record_cycles(
    port: ListeningPort,
    drive: DriveSettings,
    recorder: Scope,
    timeout_s: float,
    check: Callable[[], None] = lambda: None,
) -> tuple[float, int]:
    """Feed a scope until it has everything; return Unix time then [s], and how many SYNCs were too few.

    Args:
        port: of the drive's bus. timeout_s: how long the trigger may take. check: called with each frame;
            raises `Stopped`.

    Raises:
        RuntimeFault: MC569 no SYNC comes, or not any more, or the trigger did not come. Stopped.
    """
    for _, identifier, _ in frames_of(port, NO_SYNC_S):
        check()
        if identifier == SYNC:
            break
    else:
        raise RuntimeFault(
            "MC569",
            f"bus {drive.bus}: no SYNC came within {NO_SYNC_S:g} s: no cycle runs",
            "start the server: mcserver run",
            axis=drive.axis,
        )
    began, synced = math.nan, 0.0
    what, remedy = "the cycle ended", "see that the server runs, and that the bus is there"
    for at_s, identifier, payload in frames_of(port, timeout_s + recorder.duration_s, NO_SYNC_S):
        check()
        done = recorder.take(identifier, payload)
        if identifier == SYNC:
            synced = at_s
            if recorder.rows == 1:
                began = at_s
        if done:
            fewer = round((at_s - began) / recorder.cycle_s) - (recorder.rows - 1)
            return time.time(), fewer if fewer > max(2, 0.02 * recorder.rows) else 0
        if at_s - synced > NO_SYNC_S:
            break
        if not recorder.triggered and at_s > timeout_s:
            what = f"the trigger did not come within {timeout_s:g} s"
            remedy = "another level, or a longer time; a level that is met already fires where it is asked so"
            break
    raise RuntimeFault(
        "MC569",
        f"axis {drive.axis}: {what}; {recorder.rows} cycles were seen",
        remedy,
        axis=drive.axis,
    )
