"""Tasks with numbers by chance, as many as are wanted: of a public seed, or of one that nobody knows."""

from __future__ import annotations

import hashlib
import itertools
from pathlib import Path
from random import Random

import msgspec

from mcbenchmark.families import FAMILIES
from mcbenchmark.tasks import MAX_TASKS, Task
from mcserver.errors import ConfigurationError

PUBLIC_SEED = "public"
MIN_SEED = 16  # characters: what is shorter can be tried
MAX_SEED_FILE = 4096  # bytes


def generated_tasks(count: int, seed: str = PUBLIC_SEED) -> tuple[Task, ...]:
    """Make tasks of every family in turn; the same of one seed, whatever the computer.

    Raises:
        ConfigurationError: MC080 too many.
    """
    if not 0 < count <= MAX_TASKS:
        raise ConfigurationError("MC080", f"{count} tasks", f"1 to {MAX_TASKS} can be made")
    found = []
    for number, family in zip(range(count), itertools.cycle(FAMILIES), strict=False):
        # a number of its own for each task: another family changes no other task
        chance = hashlib.sha256(f"{seed}\0{number}\0{family.__name__}".encode()).digest()
        made = family(Random(int.from_bytes(chance, "big")))
        found.append(msgspec.structs.replace(made, id=f"{made.id}-{number + 1:04d}"))
    return tuple(found)


def split_of(seed: str) -> str:
    """Return the name of a split that says nothing of its seed: results of one split can be compared."""
    return PUBLIC_SEED if seed == PUBLIC_SEED else hashlib.sha256(f"split\0{seed}".encode()).hexdigest()[:12]


def read_seed(file: Path) -> str:
    """Read the seed of a private split from the only line of a file.

    Raises:
        ConfigurationError: MC080 it cannot be read, or is too short to be private.
    """
    try:
        with file.open("rb") as stream:
            seed = stream.read(MAX_SEED_FILE + 1).decode("utf-8").strip()
    except (OSError, UnicodeDecodeError) as error:
        reason = (error.strerror if isinstance(error, OSError) else None) or "it is not UTF-8"
        raise ConfigurationError("MC080", f"the seed {file} cannot be read: {reason}", "one line") from error
    if not MIN_SEED <= len(seed) <= MAX_SEED_FILE:
        raise ConfigurationError(
            "MC080", f"{file} has no seed of {MIN_SEED} characters or more", f"openssl rand -hex 32 > {file}"
        )
    return seed
