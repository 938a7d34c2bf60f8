"""The Rust SDK: its own tests, the contract among them; the examples of its page against a real server."""

from __future__ import annotations

import os
import shutil
import subprocess

import pytest

from tests.e2e.servers import ROOT, ServerProcess
from tests.sdks.conftest import environment

FOLDER = ROOT / "clients" / "rust"
BUILD_LIMIT_S = 280.0


def cargo(*arguments: str, **variables: str) -> str:
    """What a command of cargo prints; clippy, where it is installed, takes the compiler's place."""
    if shutil.which("cargo") is None:
        pytest.skip("cargo is not installed")
    settings = {"CARGO_INCREMENTAL": "0", "CARGO_TERM_COLOR": "never", **variables}
    if shutil.which("clippy-driver"):
        settings |= {"RUSTC_WORKSPACE_WRAPPER": "clippy-driver", "CLIPPY_ARGS": "-Dwarnings"}
    done = subprocess.run(
        ["cargo", *arguments],
        cwd=FOLDER,
        env={**os.environ, **settings},
        capture_output=True,
        text=True,
        timeout=BUILD_LIMIT_S,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_it_is_in_the_one_format() -> None:
    cargo("fmt", "--check")


def test_it_builds_without_a_warning_and_plays_the_contract() -> None:
    said = cargo("test", "--locked", "--lib", "--examples")
    assert "every_sequence_goes_as_the_contract_says ... ok" in said


def test_every_example_of_its_page_runs(server: ServerProcess) -> None:
    local = {name: "" for name in os.environ if name not in environment()}
    said = cargo("test", "--locked", "--doc", MC_CONNECT=server.endpoint, RUSTDOCFLAGS="--cfg guide", **local)
    page = (ROOT / "docs" / "rust.md").read_text("utf-8")
    assert said.count(" - guide (line") == page.count("```rust\n")
