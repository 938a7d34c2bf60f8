"""Files of the Python SDK's commands that are the server's own, since neither package needs the other."""

from __future__ import annotations

import re
from pathlib import Path
from types import MappingProxyType

ROOT = Path(__file__).parents[2]
# File of the SDK → that of the server, below its package.
SOURCES = MappingProxyType(
    {
        "mcclient/cli/visible.py": "terminal.py",
        "mcclient/cli/terminal.py": "cli/terminal_console.py",
        "mcclient/cli/repeated.py": "gcode/repeated.py",
        "mcclient/cli/render.py": "gcode/render.py",
    }
)
# Modules that they import → those of the SDK.
MODULES = MappingProxyType(
    {
        "mcserver.terminal": "mcclient.cli.visible",
        "mcserver.errors": "mcclient.types",
        "mcserver.gcode.repeated": "mcclient.cli.repeated",
        "mcserver.gcode.render": "mcclient.cli.render",
    }
)
_OWN_IMPORTS = re.compile(r"(?:^from mcclient\..*\n)+", re.MULTILINE)


def same_files() -> dict[str, str]:
    """Return the files by their paths below the SDK's folder."""
    found = {}
    for name, source in SOURCES.items():
        text = (ROOT / source).read_text("utf-8")
        for module, other in MODULES.items():
            text = text.replace(f"from {module} import", f"from {other} import")
        text = _OWN_IMPORTS.sub(lambda block: "".join(sorted(block[0].splitlines(keepends=True))), text)
        made_by = f"# mcserver/{source}, by python -m mcserver.contract.sdk clients: change it there"
        found[name] = f"{made_by}\n{text}"
    return found
