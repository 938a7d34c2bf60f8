"""The client's package from its folder, and fake servers."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
for folder in (ROOT / "clients" / "python", Path(__file__).resolve().parent):
    if str(folder) not in sys.path:
        sys.path.insert(0, str(folder))

from fake_server import FakeServer  # noqa: E402
from mcclient.cli.app import run_command_line  # noqa: E402

MakeServer = Callable[..., FakeServer]
Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def make_server() -> Iterator[MakeServer]:
    """Starts fake servers, each on a port of its own."""
    started: list[FakeServer] = []

    def make(*arguments: Any, **options: Any) -> FakeServer:
        server = FakeServer(*arguments, **options).start()
        started.append(server)
        return server

    yield make
    for server in started:
        server.go_away()


@pytest.fixture
def server(make_server: MakeServer) -> FakeServer:
    """A machine ``cell`` with three axes, whose lines end as soon as they are accepted."""
    return make_server()


@pytest.fixture
def mcctl_at(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[[str], Run]:
    """Runs command lines against an endpoint: exit code, standard output, standard error."""

    def at(endpoint: str) -> Run:
        monkeypatch.setenv("MC_CONNECT", endpoint)
        monkeypatch.setenv("NO_COLOR", "1")
        monkeypatch.setenv("COLUMNS", "140")
        return run

    def run(*arguments: str) -> tuple[int, str, str]:
        code = run_command_line(list(arguments))
        shown = capsys.readouterr()
        return code, shown.out, shown.err

    return at


@pytest.fixture
def mcctl(mcctl_at: Callable[[str], Run], server: FakeServer) -> Run:
    """Runs command lines against the fake server."""
    return mcctl_at(server.endpoint)


@pytest.fixture(autouse=True)
def _plain_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("MC_CONNECT", "MC_MACHINE"):
        monkeypatch.delenv(name, raising=False)
