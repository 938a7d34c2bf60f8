"""A scope fed from a bus that is listened to beside its master."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from mcserver.can.cob import SYNC
from mcserver.can.port import CanPort
from mcserver.canopen.bus_frames import frames_of
from mcserver.canopen.scope import Scope
from mcserver.canopen.settings import DriveSettings
from mcserver.errors import RuntimeFault

# Without a SYNC for so long no cycle runs.
NO_SYNC_S = 2.0


def record_cycles(
    port: CanPort,
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
        RuntimeFault: MC569 no SYNC, or the trigger did not come. Stopped.
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
    began = math.nan
    for at_s, identifier, payload in frames_of(port, timeout_s + recorder.duration_s):
        check()
        done = recorder.take(identifier, payload)
        if recorder.rows == 1 and identifier == SYNC:
            began = at_s
        if done:
            fewer = round((at_s - began) / recorder.cycle_s) - (recorder.rows - 1)
            return time.time(), fewer if fewer > max(2, 0.02 * recorder.rows) else 0
        if not recorder.triggered and at_s > timeout_s:
            break
    what = "the cycle ended" if recorder.triggered else f"the trigger did not come within {timeout_s:g} s"
    raise RuntimeFault(
        "MC569",
        f"axis {drive.axis}: {what}; {recorder.rows} cycles were seen",
        "another level, or a longer time; a level that is met already fires where it is asked so",
        axis=drive.axis,
    )
