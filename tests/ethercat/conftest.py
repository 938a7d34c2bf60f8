"""A namespace of its own, skipped by name where it cannot be made; a line on it; the cycle."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from tests.ethercat.rig import Cycle, Namespace, SimulatedLine, line_of, missing_means

Start = Callable[..., tuple[SimulatedLine, Cycle]]


@contextmanager
def a_namespace(name: str) -> Iterator[Namespace]:
    lacking = missing_means()
    if lacking:
        pytest.skip(lacking)
    made = Namespace(f"{name}-{os.getpid()}")
    try:
        yield made
    finally:
        made.close()


@pytest.fixture
def namespace() -> Iterator[Namespace]:
    with a_namespace("mc-ec") as made:
        yield made


@pytest.fixture(scope="module")
def lasting() -> Iterator[tuple[SimulatedLine, Cycle]]:
    """Three drives for the tests of a module: a process takes longer to start than a fault to be seen."""
    with a_namespace("mc-ecl") as made, tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "line.toml"
        file.write_text(line_of(3))
        with closing(SimulatedLine(made, file)) as line, closing(Cycle(made, line_of(3))) as cycle:
            yield line, cycle


@pytest.fixture
def energized(lasting: tuple[SimulatedLine, Cycle]) -> tuple[SimulatedLine, Cycle]:
    """The three drives without faults, energized where they stand."""
    line, cycle = lasting
    line.control.clear()
    cycle.until(lambda: {state["al"] for state in line.control.states()} == {"OP"}, "in OP")
    cycle.energize()
    return lasting


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
