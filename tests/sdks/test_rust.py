"""The Rust SDK: its own tests, the contract among them; the examples of its page against a real server."""

from __future__ import annotations

import os

import pytest

from tests.e2e.servers import ROOT, ServerProcess
from tests.sdks.cargo import cargo
from tests.sdks.conftest import environment, needed

# the first one builds Zenoh too
pytestmark = pytest.mark.timeout(1000)


@pytest.fixture(autouse=True)
def installed() -> None:
    needed("cargo")


def test_it_is_in_the_one_format() -> None:
    cargo("fmt", "--check")


def test_it_builds_without_a_warning_and_plays_the_contract() -> None:
    said = cargo("test", "--locked", "--lib", "--examples")
    assert "every_sequence_goes_as_the_contract_says ... ok" in said


def test_every_example_of_its_page_runs(server: ServerProcess) -> None:
    local = {name: "" for name in os.environ if name not in environment()}
    # one after the other: each wants the machine's axes
    said = cargo(
        *("test", "--locked", "--doc", "--", "--test-threads=1"),
        MC_CONNECT=server.endpoint,
        RUSTDOCFLAGS="--cfg guide",
        **local,
    )
    page = (ROOT / "docs" / "rust.md").read_text("utf-8")
    assert said.count(" - guide (line") == page.count("```rust\n")
