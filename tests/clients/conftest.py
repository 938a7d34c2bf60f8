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

MakeServer = Callable[..., FakeServer]


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


@pytest.fixture(autouse=True)
def _plain_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("MC_CONNECT", "MC_MACHINE"):
        monkeypatch.delenv(name, raising=False)
