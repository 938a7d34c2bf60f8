"""Runs cargo for the Rust SDK: one build that is linted, tested and driven."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from tests.e2e.servers import ROOT
from tests.sdks.built import build

FOLDER = ROOT / "clients" / "rust"


def cargo(*arguments: str, **variables: str) -> str:
    """What a command of cargo prints; clippy, where it is installed, takes the compiler's place."""
    settings = {
        "CARGO_INCREMENTAL": "0",
        "CARGO_TERM_COLOR": "never",
        # Zenoh and what it needs are compiled once for a user, whichever clone asks first; what is made of
        # them stays in the clone. Cargo before 1.91 has no such folder and compiles them in each.
        "CARGO_BUILD_BUILD_DIR": str(build_folder()),
        **variables,
    }
    if shutil.which("clippy-driver"):
        settings |= {"RUSTC_WORKSPACE_WRAPPER": "clippy-driver", "CLIPPY_ARGS": "-Dwarnings"}
    return build(["cargo", *arguments], FOLDER, **settings)


def build_folder() -> Path:
    """Where cargo keeps what it compiles: of the user, or in the clone where there is no such folder."""
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    folder = cache / "mcserver" / "cargo"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return FOLDER / "target"
    return folder if os.access(folder, os.W_OK) else FOLDER / "target"
