"""Each SDK's conformance program, built once; one server of 64 axes and one gateway to it for all tests."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from functools import wraps
from pathlib import Path
from typing import ParamSpec, TypeVar

import pytest
from mcclient import sync

from tests.e2e.conftest import served
from tests.e2e.servers import ROOT, ServerProcess
from tests.gateway.conftest import GatewayProcess, cell, tokens
from tests.sdks import languages
from tests.sdks.languages import SDKS, Sdk, ToolMissing

__all__ = ["tokens"]

AXES = 64

_P = ParamSpec("_P")
_Found = TypeVar("_Found")


def skipped_without(function: Callable[_P, _Found]) -> Callable[_P, _Found]:
    """Skip a test, by the tool's name, where the tool that a function needs is not installed."""

    @wraps(function)
    def found(*arguments: _P.args, **options: _P.kwargs) -> _Found:
        try:
            return function(*arguments, **options)
        except ToolMissing as missing:
            pytest.skip(str(missing))

    return found


needed = skipped_without(languages.needed)
go_tool = skipped_without(languages.go_tool)
typescript = skipped_without(languages.typescript)


@pytest.fixture(scope="session", params=SDKS)
def sdk(request: pytest.FixtureRequest) -> Sdk:
    """One SDK's conformance program, built."""
    return skipped_without(SDKS[request.param])()


@pytest.fixture(scope="package")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    folder = tmp_path_factory.mktemp("server")
    (folder / "cell.toml").write_text(cell(AXES), "utf-8")
    yield from served(folder, str(folder / "cell.toml"), "cell")


@pytest.fixture(scope="package")
def gateway(server: ServerProcess, tokens: tuple[Path, dict[str, str]]) -> Iterator[GatewayProcess]:
    made = GatewayProcess(server.endpoint, "--tokens", str(tokens[0]))
    yield made
    made.close()


@pytest.fixture
def machine(server: ServerProcess) -> Iterator[sync.Machine]:
    """The server as another client sees it, at rest at X0 before each test."""
    with sync.Machine.connect("cell", server.endpoint) as made:
        to_zero(made)
        yield made
    with sync.Machine.connect("cell", server.endpoint) as made:
        made.abort()
        while made.programs(ended=False):
            pass
        made.reset()


def to_zero(machine: sync.Machine) -> None:
    """Axes have energy and are at zero."""
    with machine.program("to zero", axes=[0, 1]) as program:
        program.send("G1010")
        program.send("G00 X0 Y0")


def environment() -> dict[str, str]:
    """Of a conformance program: no proxy between it and the loopback; the Python SDK from its folder."""
    kept = {key: value for key, value in os.environ.items() if not key.lower().endswith("_proxy")}
    return {**kept, "PYTHONPATH": str(ROOT / "clients" / "python")}


def program_file(folder: Path, lines: list[str]) -> Path:
    path = folder / "program.gcode"
    path.write_text("\n".join(lines) + "\n", "utf-8")
    return path
