"""``mcctl run --certificate``: a run that a signed approval lets start, and nothing else."""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path
from typing import Any

import msgspec

from mcclient.cli.options import Target
from mcclient.cli.output import carry_out, say, write_json
from mcclient.errors import ConfigurationError, RequestRefused
from mcclient.texts import text_of_program
from mcclient.types import ENDED, ProgramStatus

LOOK_S = 0.1
MAX_FILE = 1024 * 1024  # bytes: more is refused by the server anyway


def run_certified(target: Target, file: str, certificate: Path, json: bool) -> int:
    """Have a run armed by its certificate, start it, and follow it to its end.

    Returns:
        The exit code: 0 finished, 1 another end.
    """

    async def run() -> ProgramStatus:
        text, approval = read_text(file), read_text(str(certificate))
        async with target.open() as one:
            asked = await one.request_run(text, Path(file).name[:200], certificate=approval)
            if asked.run is None:
                fault = asked.diagnostics[0]
                raise RequestRefused(fault.code, f"line {fault.line}: {fault.message}", fault.hint)
            started = await one.run_armed(text)
            if not json:
                say(f"{one.name}: {started.program}, approved by {asked.run.operator}")
            while True:
                (found,) = await one.programs(started.program)
                if str(found.state) in ENDED:
                    return found
                await asyncio.sleep(LOOK_S)

    ended = carry_out(run, json)
    finished = str(ended.state) == "finished"
    if json:
        write_json({"ok": finished, "program": msgspec.to_builtins(ended)})
    else:
        say(f"{ended.program}: {ended.state}" + (f": {ended.fault.message}" if ended.fault else ""))
    return 0 if finished else 1


def read_text(file: str) -> str:
    """Read a file, or standard input for ``-``.

    Raises:
        ConfigurationError: MC537 it cannot be read. RequestRefused: MC511 it is no text.
    """
    try:
        raw: Any
        if file == "-":
            raw = sys.stdin.buffer.read(MAX_FILE + 1)
        else:
            with Path(file).open("rb") as stream:
                raw = stream.read(MAX_FILE + 1)
    except OSError as error:
        raise ConfigurationError("MC537", f"{file} cannot be read: {error}", "give another file") from error
    return text_of_program(raw, file)
