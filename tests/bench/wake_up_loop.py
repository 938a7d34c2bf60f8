"""The executor's way of waking up, without an executor: prints how late each wake-up was [ns]."""

from __future__ import annotations

import gc
import sys

from mcserver.executor.realtime import MonotonicClock, lock_memory, take_realtime_priority


def main(cycles: int, period: int) -> None:
    """Sleep to absolute times, note how late."""
    take_realtime_priority()
    lock_memory()
    gc.collect()
    gc.freeze()
    gc.disable()
    clock = MonotonicClock()
    late = [0] * cycles
    deadline = clock.now()
    for cycle in range(cycles):
        deadline += period
        clock.sleep_until(deadline)
        late[cycle] = clock.now() - deadline
    print("\n".join(map(str, late)))


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
