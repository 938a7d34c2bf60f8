"""Each SDK's own tests, which play the contract, and the form of its sources."""

from __future__ import annotations

from tests.e2e.servers import ROOT
from tests.sdks.built import build
from tests.sdks.conftest import go_tool, needed, typescript


def test_the_go_sdk_passes_its_tests() -> None:
    go, folder = go_tool(), ROOT / "clients" / "go"
    build([go, "vet", "./..."], folder)
    build([go, "test", "-timeout", "100s", "./..."], folder)


def test_the_go_sdk_is_formatted() -> None:
    go_tool()
    assert not build([needed("gofmt"), "-l", "."], ROOT / "clients" / "go")


def test_the_typescript_sdk_plays_the_contract() -> None:
    folder = ROOT / "clients" / "typescript"
    typescript()
    build([needed("node"), "--test", "test/"], folder)
