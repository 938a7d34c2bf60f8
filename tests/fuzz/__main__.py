"""Inputs without end: ``make fuzz ARGS="--seconds 3600 --seed 1"``; ``--inputs 1000000``; ``--target EDS``.

``--target port``, ``gateway``, ``page``: raw bytes at the port of a server that runs a program, and of what
serves HTTP beside it, targets of their own.
What is found is printed with the seed and the number of its input, and written to a file; it becomes a test.
"""

from __future__ import annotations

import argparse
import random
import sys
import time
import traceback
from collections import Counter
from pathlib import Path

from tests.fuzz import doors, port
from tests.fuzz.mutation import mutated
from tests.fuzz.targets import Target, targets

REPORT_S = 60.0
# one of an input that takes longer than this is said too: who sends it stops a worker
SLOW_S = 5.0


def input_of(target: Target, name: str, seed: int, number: int) -> bytes:
    """Input ``number`` of a target: the same for the same seed."""
    return mutated(random.Random(f"{seed}/{name}/{number}"), target.seeds)


def fault_of(target: Target, data: bytes) -> str:
    """What is wrong with how the target takes its input; empty: nothing."""
    start = time.process_time()
    try:
        target.run(data)
    except target.refusals:
        pass
    except Exception:
        return traceback.format_exc(limit=-6)
    taken = time.process_time() - start
    return f"takes {taken:.1f} s\n" if taken > SLOW_S else ""


def main() -> int:
    """The exit code: 1 where something was found."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--seconds", type=float, default=60.0)
    options.add_argument("--inputs", type=int, default=0, help="instead of a time")
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--target", default="")
    options.add_argument("--findings", type=Path, default=Path("out/fuzz"))
    chosen = options.parse_args()
    if chosen.target == "port":
        return port.run(chosen.seconds, chosen.inputs, chosen.seed)
    if chosen.target in ("gateway", "page"):
        return doors.run(chosen.target, chosen.seconds, chosen.inputs, chosen.seed)
    available = {name: each for name, each in targets().items() if chosen.target in ("", name)}
    started = reported = time.monotonic()
    counts: Counter[str] = Counter()
    found: Counter[str] = Counter()
    number = 0
    while number < chosen.inputs if chosen.inputs else time.monotonic() < started + chosen.seconds:
        for name, target in available.items():
            for _ in range(target.share):
                data = input_of(target, name, chosen.seed, counts[name])
                wrong = fault_of(target, data)
                if wrong:
                    found[name] += 1
                    _report(chosen.findings, name, chosen.seed, counts[name], data, wrong)
                counts[name] += 1
                number += 1
        now = time.monotonic()
        if now - reported > REPORT_S:
            reported = now
            print(f"{now - started:7.0f} s  {number} inputs, {sum(found.values())} findings", flush=True)
    for name, count in counts.items():
        print(f"{count:10} inputs: {name}{f', {found[name]} findings' if found[name] else ''}")
    print(f"{number:10} in all, {sum(found.values())} findings")
    return 1 if found else 0


def _report(folder: Path, name: str, seed: int, number: int, data: bytes, wrong: str) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name.replace(' ', '-')}-{seed}-{number}"
    path.write_bytes(data)
    print(f"{name}, seed {seed}, input {number}, kept in {path}:\n{wrong}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
