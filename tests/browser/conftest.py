"""A motion server, the operator's page of it, and Chromium: each one for all tests of this folder."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from mcclient import sync

from tests.e2e.servers import ROOT, ServerProcess, environment

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = [
    "--no-sandbox",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-quic",
    "--enable-unsafe-swiftshader",
]
# generous: the first check of a server compiles, and the computer may be busy
LIMIT_MS = 120_000

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")

if CHROMIUM is None:
    pytest.skip("chromium is not installed", allow_module_level=True)


class PageProcess:
    """``mcserver web`` as a process of its own."""

    def __init__(self, endpoint: str, folder: Path, *options: str) -> None:
        command = [sys.executable, "-m", "mcserver", "web", "--port", "0", "--connect", endpoint]
        self.process = subprocess.Popen(
            [*command, "--programs", str(folder), "--json", *options],
            stdout=subprocess.PIPE,
            text=True,
            env=environment(),
            cwd=ROOT,
        )
        assert self.process.stdout is not None
        self.url: str = json.loads(self.process.stdout.readline())["url"]

    def close(self) -> None:
        """Ends it in order; kills it where it does not end."""
        self.process.terminate()
        try:
            self.process.wait(20.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        assert self.process.stdout is not None
        self.process.stdout.close()


@pytest.fixture(scope="session")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    made = ServerProcess(tmp_path_factory.mktemp("server"), "cartesian", "bench", recorder=True)
    made.start()
    yield made
    made.close()


@pytest.fixture(scope="session")
def site(server: ServerProcess, tmp_path_factory: pytest.TempPathFactory) -> Iterator[PageProcess]:
    made = PageProcess(server.endpoint, tmp_path_factory.mktemp("programs"))
    yield made
    made.close()


# not longer than a module: while it is open, no other loop can run in this thread
@pytest.fixture(scope="module")
def browser() -> Iterator[playwright.Browser]:
    with playwright.sync_playwright() as driver:
        made = driver.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield made
        made.close()


@pytest.fixture
def page(browser: playwright.Browser, request: pytest.FixtureRequest) -> Iterator[playwright.Page]:
    context = browser.new_context(viewport={"width": 1920, "height": 1080})
    context.set_default_timeout(LIMIT_MS)
    made = context.new_page()
    yield made
    if os.environ.get("SCREENSHOTS"):
        made.screenshot(path=f"{os.environ['SCREENSHOTS']}/{request.node.name}.png", full_page=True)
    context.close()


@pytest.fixture
def machine(server: ServerProcess) -> Iterator[sync.Machine]:
    """The server as another client sees it, without latched faults before and after."""
    with sync.Machine.connect("bench", server.endpoint) as made:
        yield made
        made.abort()
        while made.programs(ended=False):
            pass
        made.reset()
        made.override(100.0)
