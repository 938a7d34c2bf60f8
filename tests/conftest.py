"""What all tests share: the groups in which they run, and how kernels run in their process."""

from __future__ import annotations

import builtins
import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

# A command that runs in the tests' process must not choose plain Python for the rest of them: it does so
# only before the kernels are imported.
import mcserver.motion.kernels.compiled  # noqa: F401
from mcserver.motion.compiling import needs_compiler

ROOT = Path(__file__).parent

# no test depends on how much of a core it gets
settings.register_profile("without-deadline", settings(), deadline=None)
settings.load_profile("without-deadline")

# What a test is, by its file or folder; all others compute, or wait for nothing but themselves.
GROUPS = {
    # servers, executors or buses in real time: they mostly wait, and run few at a time
    "realtime": (
        "can/test_hub.py",
        "canopen",
        "cli/test_run.py",
        "cli/test_streams.py",
        "clients",
        "drive_sim/test_process.py",
        "drives/test_executor_process_on_can.py",
        "e2e",
        "e2e_can",
        "ethercat",
        "executor/test_process.py",
        "fire",
        "fuzz/test_port.py",
        "gateway",
        "language/test_agents.py",
        "language/test_agents_http.py",
        "mqtt/test_broker.py",
        "net",
        "opcua/test_server.py",
        "packaging",
        "planning/test_planner_process.py",
        "security",
        "socketcan",
        "view/test_command.py",
    ),
    # SDKs of other languages, the pages in Chromium, an editor: real time too, and tools of others
    "clients": ("browser", "language/test_neovim.py", "sdks"),
}
COMPUTING = "computing"
# layers that make setpoints, or what decides about them
EXACT = tuple(
    f"mcserver.{each}"
    for each in ["clearance", "executor", "gcode", "machine", "motion", "planning", "simulation"]
)
# folders whose tests share a server: one process runs them all, where each would start its own
TOGETHER = ("browser", "gateway", "opcua", "sdks")
# what takes longest, and begins first: nothing long is left for the end
LONG = (
    "browser",
    "sdks",
    "e2e_can",
    "e2e/test_restart.py",
    "security",
    "gateway",
    "canopen/test_families.py",
    "fire",
    "packaging",
)


def group_of(place: Path) -> str:
    """The group of a file or folder below this one."""
    for group, places in GROUPS.items():
        if any(place.is_relative_to(each) for each in places):
            return group
    return COMPUTING


def chosen_groups(expression: str) -> set[str]:
    """The groups that ``-m`` chooses, as ``realtime or clients``; empty where it chooses otherwise."""
    words = expression.split()
    named = set(words[::2])
    return named if named <= {*GROUPS, COMPUTING} and set(words[1::2]) <= {"or"} else set()


def pytest_sessionstart(session: pytest.Session) -> None:
    """Compile what is not kept: servers that plan without machine code are slow, and have their own tests."""
    if not hasattr(session.config, "workerinput") and needs_compiler():
        subprocess.run([sys.executable, "-m", "mcserver.motion.warm_up"], check=True)


@pytest.fixture(scope="session", autouse=True)
def same_sums() -> Iterator[None]:
    """Let no layer that makes setpoints add up floats by ``sum``: Python 3.11 rounds after each, 3.12 at the
    end. ``math.fsum`` is the same in all versions."""
    plain = sum

    def whole(values: Iterable[Any], /, start: Any = 0) -> Any:
        found = plain(values, start)
        caller = sys._getframe(1).f_globals.get("__name__", "")
        inexact = isinstance(found, float) and caller.startswith((*EXACT, "mckinematics"))
        assert not inexact, f"{caller} adds up floats by sum: take math.fsum"
        return found

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(builtins, "sum", whole)
        yield


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out the files of other groups, which each worker would import to run none of their tests."""
    chosen = chosen_groups(config.option.markexpr)
    if not chosen or not collection_path.is_relative_to(ROOT) or collection_path == ROOT:
        return None
    place = collection_path.relative_to(ROOT)
    leads_there = any(
        Path(each).is_relative_to(place) for group in chosen - {COMPUTING} for each in GROUPS[group]
    )
    return None if group_of(place) in chosen or leads_there else True


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark each test with its group; the files that take longest come first."""
    # once a file: it would take half a second in each process to look for each test
    places = {path: path.relative_to(ROOT) for path in {item.path for item in items}}
    groups = {path: group_of(place) for path, place in places.items()}
    orders = {path: order_of(place) for path, place in places.items()}
    for item in items:
        item.add_marker(groups[item.path])
    items.sort(key=lambda item: orders[item.path])


def order_of(place: Path) -> int:
    """Where a file stands in the order of files; those that take no longer than others come last."""
    found = (number for number, each in enumerate(LONG) if place.is_relative_to(each))
    return next(found, len(LONG))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Deal out ``--dist loadscope`` by file, and by folder where a folder's tests share a server."""
    if config.option.dist != "loadscope":
        return None
    from xdist.scheduler import LoadScopeScheduling

    class ByServer(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file = nodeid.partition("::")[0]
            folder = file.removeprefix(f"{ROOT.name}/").partition("/")[0]
            return folder if folder in TOGETHER else file

    return ByServer(config, log)
