"""Programs under fire: ``make fire ARGS="--minutes 60 --seed 1"``, or one ``--fault CUT``. Needs root.

After each program journal, acknowledgements and axis have to agree line for line; the first that does not is
printed with its seed and number.
"""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from tests.fire.disk import StallingDisk
from tests.fire.fire import Fault, burn, make_server
from tests.fire.link import MissingMeans, bad_link

# a planner that ends again and again is given up by its server
PLANNER_EVERY_S = 25.0


def main() -> int:
    """The exit code: 0 where everything agrees, 2 where this computer lacks what it needs."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--minutes", type=float, default=10.0)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--fault", choices=[fault.name for fault in Fault])
    chosen = options.parse_args()
    kinds = [Fault[chosen.fault]] if chosen.fault else list(Fault)
    try:
        with bad_link(chosen.seed) as link, tempfile.TemporaryDirectory() as folder:
            disk = StallingDisk(Path(folder))
            server = make_server(link, Path(folder), disk)
            try:
                server.start()
                end = time.monotonic() + 60.0 * chosen.minutes
                counts: Counter[Fault] = Counter()
                worst: dict[Fault, float] = {}
                number, planner_again = 0, 0.0
                while time.monotonic() < end:
                    number += 1
                    chance = random.Random(f"{chosen.seed}/{number}")
                    fault = chance.choice(kinds)
                    if fault is Fault.PLANNER_KILLED:
                        time.sleep(max(0.0, planner_again - time.monotonic()))
                        planner_again = time.monotonic() + PLANNER_EVERY_S
                    outcome = burn(link, server, fault, chance, disk)
                    shown = f"{outcome.state}, {outcome.accepted} accepted, {outcome.done} done"
                    print(
                        f"{number:5} {fault.name:26} {shown}, at rest after {outcome.recovery_s:.1f} s",
                        flush=True,
                    )
                    if outcome.wrong:
                        print(f"seed {chosen.seed}, program {number}, {fault.value}: {outcome.wrong}")
                        return 1
                    counts[fault] += 1
                    worst[fault] = max(worst.get(fault, 0.0), outcome.recovery_s)
                for fault in kinds:
                    rest = f"at rest after {worst.get(fault, 0.0):5.1f} s at most"
                    print(f"{counts[fault]:6} programs, {rest}: {fault.value}")
                print(f"{number:6} in all, {link.lost} of {link.carried + link.lost} packets lost; all agree")
            except BaseException:
                sys.stderr.write("".join(server.said))
                raise
            finally:
                server.close()
    except MissingMeans as missing:
        print(missing, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
