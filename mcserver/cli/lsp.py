"""``mcserver lsp``: the language server for editors, over standard input and output."""

from __future__ import annotations

from mcserver.cli.options import DEFAULT_MACHINE, MachineOption
from mcserver.errors import ConfigurationError
from mcserver.machine.machine_file import load_machine


def lsp(machine: MachineOption = DEFAULT_MACHINE) -> None:
    """Serve an editor over standard input and output: diagnostics, completion, hover, times, formatting."""
    described = load_machine(machine)
    try:
        from mcserver.language.lsp.server import build_server
    except ImportError as error:
        raise ConfigurationError(
            "MC016",
            f"the language server needs {error.name}",
            "install the extra: pip install 'mcserver[lsp]'",
        ) from error
    build_server(described, machine).start_io()
