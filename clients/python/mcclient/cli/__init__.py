"""The command ``mcctl``. Importing this needs nothing; running it needs the extra ``cli``."""

from __future__ import annotations

import importlib.util
import sys

NEEDED = ("typer", "rich", "prompt_toolkit")
CONFIGURATION = 3


def main() -> None:
    """Entry point; leaves the process with the documented exit code."""
    missing = [name for name in NEEDED if importlib.util.find_spec(name) is None]
    if missing:
        sys.stderr.write(
            f"error[MC537]: mcctl needs {', '.join(missing)}, not installed here\n"
            "  = help: pip install 'mcclient[cli]'\n"
        )
        sys.exit(CONFIGURATION)
    from mcclient.cli.app import run_command_line

    sys.exit(run_command_line())
