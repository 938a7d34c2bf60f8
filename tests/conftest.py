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


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests with servers, executors or buses in real time."""
    for item in items:
        place = item.path.relative_to(ROOT)
        if any(place.is_relative_to(each) for each in REALTIME):
            item.add_marker(pytest.mark.realtime)
