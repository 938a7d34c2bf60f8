"""What all tests share: the two groups in which they run, and how kernels run in their process."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import settings

# A command that runs in the tests' process must not choose plain Python for the rest of them: it does so
# only before the kernels are imported.
import mcserver.motion.kernels.compiled  # noqa: F401

ROOT = Path(__file__).parent

# no test depends on how much of a core it gets
settings.register_profile("without-deadline", settings(), deadline=None)
settings.load_profile("without-deadline")

# Files and folders with servers, executors or buses in real time: they mostly wait, and run few at a time.
# All others compute, or wait for nothing but themselves: they run beside these, on all cores, at the lowest
# priority.
REALTIME = (
    "browser",
    "can/test_hub.py",
    "canopen",
    "cli/test_run.py",
    "cli/test_streams.py",
    "cli/test_tutorial.py",
    "clients",
    "drive_sim/test_process.py",
    "drives/test_executor_process_on_can.py",
    "e2e",
    "e2e_can",
    "executor/test_process.py",
    "fire",
    "gateway",
    "net",
    "packaging",
    "planning/test_planner_process.py",
    "sdks",
    "security",
    "socketcan",
    "view/test_window.py",
)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out the files of the other group, which each worker would import to run none of their tests."""
    if not collection_path.is_relative_to(ROOT) or collection_path == ROOT:
        return None
    place = collection_path.relative_to(ROOT)
    match config.option.markexpr:
        case "realtime":
            leads_there = any(Path(each).is_relative_to(place) for each in REALTIME)
            return None if is_realtime(place) or leads_there else True
        case "not realtime":
            return True if is_realtime(place) else None
        case _:
            return None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests with servers, executors or buses in real time."""
    for item in items:
        if is_realtime(item.path.relative_to(ROOT)):
            item.add_marker(pytest.mark.realtime)


def is_realtime(place: Path) -> bool:
    """Whether a file or folder below this one has servers, executors or buses in real time."""
    return any(place.is_relative_to(each) for each in REALTIME)
