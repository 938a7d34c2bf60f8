"""Words come to terminals and logs in one way each, which lets nothing in them be obeyed."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDERS = tuple(
    ROOT / each
    for each in (
        "mcserver",
        "clients/python/mcclient",
        "clients/benchmark/mcbenchmark",
        "clients/gym/mcclient_gym",
        "clients/lerobot/lerobot_robot_mcserver",
    )
)
# what writes to a terminal or a log by itself, and the only files that may
FORBIDDEN = {
    "Console": (),
    "print_exc": (),
    "print": ("mcserver/executor/process.py",),
    "echo": ("mcserver/cli/app.py", "clients/python/mcclient/cli/app.py"),
    "secho": (),
    "confirm": ("clients/python/mcclient/cli/arm.py",),
    "input": ("clients/python/mcclient/cli/fleet.py",),
    "basicConfig": ("mcserver/processes.py", "mcserver/cli/run.py"),
    "StreamHandler": ("mcserver/processes.py",),
    "RichHandler": (),
    # with a log of its own: give it log_config=None
    "uvicorn": (),
    # beside the two modules with `write_text` and `write_json`: words of our own, and JSON by `json_bytes`
    "write": (
        "mcserver/cli/console.py",
        "mcserver/cli/fix.py",
        "mcserver/cli/simulation_report.py",
        "mcserver/can/hub.py",
        "mcserver/web/replay.py",
        "clients/python/mcclient/cli/__init__.py",
        "clients/python/mcclient/cli/output.py",
    ),
}
STREAMS = {"sys.stdout", "sys.stderr", "sys.stdout.buffer", "sys.stderr.buffer"}


def writes(source: str) -> list[tuple[int, str]]:
    """Lines and names of the calls that write by themselves; `print` is a method of consoles too."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Attribute) and node.attr in ("write", "writelines"):
            if ast.unparse(node.value) in STREAMS:
                found.append((node.lineno, "write"))
        elif isinstance(node, ast.Call):
            last = getattr(node.func, "attr", getattr(node.func, "id", ""))
            if last not in (*FORBIDDEN, "Config", "run"):
                continue
            name = ast.unparse(node.func)
            if name in ("uvicorn.Config", "uvicorn.run") and not any(
                each.arg == "log_config" for each in node.keywords
            ):
                found.append((node.lineno, "uvicorn"))
            if last in FORBIDDEN and last != "write" and (last not in ("print", "input") or last == name):
                found.append((node.lineno, last))
    return found


def test_nothing_is_written_beside_the_consoles_and_the_log() -> None:
    found = []
    for folder in FOLDERS:
        for file in sorted(folder.rglob("*.py")):
            place = file.relative_to(ROOT).as_posix()
            for line, name in writes(file.read_text("utf-8")):
                if place not in FORBIDDEN[name]:
                    found.append(f"{place}:{line}: {name}")
    assert found == []


@pytest.mark.parametrize(
    "text",
    [
        "from rich.console import Console\nConsole().print('x')",
        "print('x')",
        "import typer\ntyper.echo('x')",
        "import sys\nsys.stdout.buffer.write(b'x')",
        "import sys\nwrite = sys.stderr.write",
        "import logging\nlogging.basicConfig()",
        "import uvicorn\nuvicorn.Config(app, log_level='warning')",
    ],
)
def test_a_way_around_is_found(text: str) -> None:
    assert writes(text)


def test_our_consoles_print() -> None:
    assert writes("results().print('x')\nfile.write('x')") == []
