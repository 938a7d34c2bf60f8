"""`mckinematics` by itself: in a process that has no server, with values of its own."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "kinematics"

# the example of its README, with the server out of reach
PROGRAM = """
import re, sys
sys.modules["mcserver"] = None
text = open("README.md", encoding="utf-8").read()
exec(re.search(r"```python\\n(.*?)```", text, re.S)[1])
print(pose)
"""


def test_the_example_of_its_readme_runs_without_the_server() -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        cwd=FOLDER,
        env={"PYTHONPATH": str(FOLDER)},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "Pose(" in done.stdout


def test_the_example_of_its_page_runs(capsys: pytest.CaptureFixture[str]) -> None:
    page = (FOLDER.parent / "docs" / "kinematics.md").read_text("utf-8")
    exec(re.findall(r"```python\n(.*?)```", page, re.S)[-1], {})
    assert capsys.readouterr().out.startswith("(-0.159, -0.4, ")


def test_no_file_of_it_names_the_server_s_packages() -> None:
    for file in (FOLDER / "mckinematics").glob("*.py"):
        text = file.read_text("utf-8")
        assert "import mcserver" not in text, file
        assert "from mcserver" not in text, file
