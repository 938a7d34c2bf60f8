"""The examples of docs/sdk.md run as they are printed."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from fake_server import FakeServer

ROOT = Path(__file__).resolve().parents[2]
GUIDE = (ROOT / "docs" / "sdk.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"```python\n(.*?)```", GUIDE, re.DOTALL)


@pytest.mark.parametrize(
    "example", EXAMPLES, ids=lambda text: f"line {GUIDE[: GUIDE.index(text)].count(chr(10))}"
)
def test_an_example_of_the_guide_runs(server: FakeServer, example: str) -> None:
    stop = threading.Event()
    rows = np.zeros((10, 3, 4), dtype="<f4").tobytes()

    def publish() -> None:
        while not stop.wait(0.02):
            server.publish_state()
            server.publish_samples(rows, 10)

    publishing = threading.Thread(target=publish)
    publishing.start()
    environment = {
        **os.environ,
        "MC_CONNECT": server.endpoint,
        "PYTHONPATH": str(ROOT / "clients" / "python"),
        "PYTHONWARNINGS": "error",
    }
    try:
        done = subprocess.run(
            [sys.executable, "-c", example],
            env=environment,
            capture_output=True,
            text=True,
            timeout=30,
            check=False,
        )
    finally:
        stop.set()
        publishing.join()
    assert (done.returncode, done.stderr) == (0, "")


def test_the_guide_names_every_error() -> None:
    import mcclient

    for name in mcclient.__all__:
        thing = getattr(mcclient, name)
        if isinstance(thing, type) and issubclass(thing, Exception):
            assert thing.__doc__
    for name in re.findall(r"^\| `(\w+)` \|", GUIDE, re.MULTILINE):
        assert name in mcclient.__all__
