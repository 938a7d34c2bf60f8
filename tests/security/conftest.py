"""A site with its router, made by the product itself, and a server behind it.

The router is a session of Zenoh's library; where a ``zenohd`` is found, all is tried on that one too.
"""

from __future__ import annotations

import datetime
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh

from mcserver.security.site import Role, Site, User
from mcserver.security.site_files import ROUTER, configuration_path
from mcserver.security.site_folder import write_site
from tests.bench.server import free_port

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "clients" / "python"))

NOW = datetime.datetime.now(datetime.UTC)
MACHINE = "bench"
ROUTERS = ("library", *(["zenohd"] if shutil.which("zenohd") else []))
# how long a router may take to listen
LISTENS_S = 30.0


class RunningSite:
    """A folder and the router that runs with it."""

    def __init__(self, folder: Path, *, passwords: bool = False, router: str = "library") -> None:
        self.folder = folder
        self._sessions: list[zenoh.Session] = []
        self._process: subprocess.Popen[bytes] | None = None
        self.site = Site(
            "127.0.0.1",
            port=free_port(),
            machines=(MACHINE, "other"),
            users=(
                User("alice", Role.OPERATOR, (MACHINE,)),
                User("bob", Role.OBSERVER),
                User("eve", Role.ENGINEER),
                User("bot", Role.AGENT, (MACHINE,)),
            ),
            passwords=passwords,
        )
        write_site(folder, self.site, NOW)
        if router == "zenohd":
            self._process = self._started()
            return
        config = zenoh.Config.from_file(self.path(ROUTER))
        config.insert_json5("listen/endpoints", f'["{self.site.endpoint}"]')
        self._sessions.append(zenoh.open(config))

    def path(self, identity: str) -> Path:
        return configuration_path(self.folder, identity)

    def session(self, identity: str, **settings: str) -> zenoh.Session:
        """A plain session with this identity's configuration."""
        config = zenoh.Config.from_file(self.path(identity))
        for key, value in {"connect/timeout_ms": "3000", **settings}.items():
            config.insert_json5(key, value)
        self._sessions.append(zenoh.open(config))
        return self._sessions[-1]

    def close(self) -> None:
        for session in reversed(self._sessions):
            session.close()  # type: ignore[no-untyped-call]
        if self._process is not None:
            self._process.terminate()
            self._process.wait(LISTENS_S)

    def _started(self) -> subprocess.Popen[bytes]:
        process = subprocess.Popen(["zenohd", "--config", str(self.path(ROUTER))], stderr=subprocess.DEVNULL)
        limit = time.monotonic() + LISTENS_S
        while time.monotonic() < limit and process.poll() is None:
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", self.site.port)) == 0:
                    return process
            time.sleep(0.1)
        process.kill()
        process.wait()
        raise AssertionError("zenohd does not listen with the site's configuration")


@pytest.fixture(scope="module", params=ROUTERS)
def site(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Iterator[RunningSite]:
    site = RunningSite(tmp_path_factory.mktemp("site"), router=request.param)
    yield site
    site.close()
