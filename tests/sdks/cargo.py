"""Runs cargo for the Rust SDK: one build that is linted, tested and driven."""

from __future__ import annotations

import os
import shutil
import subprocess

from tests.e2e.servers import ROOT

FOLDER = ROOT / "clients" / "rust"
# Zenoh, or Maven's downloads, on a busy computer [s].
BUILD_LIMIT_S = 900.0


def cargo(*arguments: str, **variables: str) -> str:
    """What a command of cargo prints; clippy, where it is installed, takes the compiler's place."""
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
