"""A motion server on simulated axes, and a gateway to it: each one for all tests of this folder."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from tests.e2e.conftest import served
from tests.e2e.servers import CommandProcess, ServerProcess
from tests.machine_text import axes_text


class GatewayProcess:
    """``mcserver gateway`` as a process of its own."""

    def __init__(self, endpoint: str, *options: str, inside: Sequence[str] = ()) -> None:
        command = CommandProcess(
            # the last one counts
            "gateway",
            "--port",
            "0",
            "--connect",
            endpoint,
            *options,
            inside=inside,
        )
        self.process, self.url, self.close = command.process, command.url.rstrip("/"), command.close
        self.ws = self.url.replace("http", "ws", 1) + "/v1/ws"


def cell(axes: int, cycle_hz: int = 1000) -> str:
    """The machine file of a cell with ideal drives."""
    head = f'[machine]\nname = "cell"\ncycle_hz = {cycle_hz}\n'
    return head + axes_text(range(axes), velocity=500.0, acceleration=5000.0)


@pytest.fixture(scope="package")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    folder = tmp_path_factory.mktemp("server")
    # none of these tests is about its rate, and an idle one at 1 kHz takes a tenth of a core
    (folder / "cell.toml").write_text(cell(3, cycle_hz=250), "utf-8")
    yield from served(folder, str(folder / "cell.toml"), "cell")


@pytest.fixture(scope="package")
def tokens(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, str]]:
    """The token file, and a token for each role."""
    from mcserver.gateway.tokens import add_token
    from mcserver.web.users import Role

    file = tmp_path_factory.mktemp("tokens") / "tokens"
    return file, {role.value: add_token(file, role.value, role) for role in Role}


@pytest.fixture(scope="package")
def gateway(server: ServerProcess, tokens: tuple[Path, dict[str, str]]) -> Iterator[GatewayProcess]:
    made = GatewayProcess(server.endpoint, "--tokens", str(tokens[0]), "--origin", "https://panel.example")
    yield made
    made.close()
