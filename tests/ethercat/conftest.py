"""A namespace of its own, skipped by name where it cannot be made; a line on it; the cycle."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.ethercat.rig import Cycle, Namespace, SimulatedLine, line_of, missing_means

Start = Callable[..., tuple[SimulatedLine, Cycle]]


@pytest.fixture
def namespace() -> Iterator[Namespace]:
    lacking = missing_means()
    if lacking:
        pytest.skip(lacking)
    made = Namespace(f"mc-ec-{os.getpid()}")
    yield made
    made.close()


@pytest.fixture
def simulate(namespace: Namespace, tmp_path: Path) -> Iterator[Callable[[str], SimulatedLine]]:
    """Put the drives of a machine file on the line."""
    made: list[SimulatedLine] = []

    def start(text: str) -> SimulatedLine:
        file = tmp_path / "line.toml"
        file.write_text(text)
        made.append(SimulatedLine(namespace, file))
        return made[-1]

    yield start
    for line in made:
        line.close()


@pytest.fixture
def start(namespace: Namespace, simulate: Callable[[str], SimulatedLine]) -> Iterator[Start]:
    """So many drives, simulated and booted; ``drive``: more lines of each."""
    made: list[Cycle] = []

    def begin(count: int, **keys: object) -> tuple[SimulatedLine, Cycle]:
        text = line_of(count, **keys)  # type: ignore[arg-type]
        line = simulate(text)
        made.append(Cycle(namespace, text))
        return line, made[-1]

    yield begin
    for cycle in made:
        cycle.close()
