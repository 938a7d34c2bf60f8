"""``mcserver grammar``: the dialect's grammar for constrained decoders, parsers and editors."""

from __future__ import annotations

from typing import Annotated

import typer

from mcserver.cli.console import write_text
from mcserver.cli.options import MachineOption
from mcserver.language.grammar.dialect import build_grammar
from mcserver.language.grammar.notations import Notation, write_grammar
from mcserver.machine.machine_file import load_machine


def grammar(
    notation: Annotated[
        Notation, typer.Option("--format", "-f", help="The notation; gbnf is that of llama.cpp.")
    ] = Notation.EBNF,
    machine: MachineOption = "",
) -> None:
    """Print the grammar of programs, for any machine or for the axes and tools of one."""
    described = load_machine(machine) if machine else None
    write_text(write_grammar(build_grammar(described), notation))
