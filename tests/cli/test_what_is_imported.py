"""A command imports what it needs: servers start sooner, and a first simulation waits for no compiler."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

SCRIPT = """
import json, sys
from mcserver.cli.app import COMMANDS, GROUPS, build_app
found = {}
for name in [*COMMANDS, *GROUPS]:
    build_app(name)
    found[name] = [each for each in ("mcserver.motion.kernels.compiled", "numba") if each in sys.modules]
import mcserver.server
print(json.dumps({"commands": found, "server": "numba" in sys.modules}))
"""


def last_line(script: str) -> Any:
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


def test_neither_a_command_nor_the_server_itself_imports_kernels() -> None:
    """`prepare_planner` chooses plain Python for a short program only while no kernel is imported."""
    found = last_line(SCRIPT)
    assert {name: kernels for name, kernels in found["commands"].items() if kernels} == {}
    assert not found["server"]


def test_the_command_that_is_called_is_the_only_one_imported() -> None:
    script = (
        "import json, sys; from mcserver.cli.app import run_command_line\n"
        "run_command_line(['examples', '--json'])\n"
        "print(json.dumps([each for each in sys.modules if each.startswith('mcserver.cli.')]))"
    )
    modules = last_line(script)
    assert "mcserver.cli.examples" in modules
    assert not {"mcserver.cli.run", "mcserver.cli.simulate", "mcserver.cli.plot"} & set(modules)


def test_an_emergency_stop_by_mcctl_imports_no_other_command() -> None:
    script = (
        "import json, sys; from mcclient.cli.app import build_app; build_app('estop')\n"
        "print(json.dumps([each for each in sys.modules if each.startswith(('mcclient.cli.', 'rich.live'))]))"
    )
    assert not {"mcclient.cli.console", "mcclient.cli.run", "mcclient.cli.arm"} & set(last_line(script))
