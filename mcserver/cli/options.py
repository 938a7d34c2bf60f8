"""Options and arguments that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mcserver.machine.machine_file import BUILT_IN


def _complete_machine(incomplete: str) -> list[str]:
    names = [*BUILT_IN, *sorted(str(path) for path in Path().glob("*.toml"))]
    return [name for name in names if name.startswith(incomplete)]


def _complete_program(incomplete: str) -> list[str]:
    base = Path(incomplete)
    folder = base if incomplete.endswith("/") else base.parent
    prefix = "" if str(folder) == "." else f"{folder}/"
    try:
        entries = sorted(folder.iterdir())
    except OSError:
        return []
    names = [f"{prefix}{entry.name}" + ("/" if entry.is_dir() else "") for entry in entries]
    return [name for name in names if name.startswith(incomplete)]


MachineOption = Annotated[
    str,
    typer.Option(
        "--machine",
        "-m",
        metavar="M",
        help="A built-in machine (cartesian, robot-dog, arm6) or a TOML file.",
        autocompletion=_complete_machine,
    ),
]
ProgramArgument = Annotated[
    str,
    typer.Argument(
        metavar="FILE", help="The G-code program; - reads standard input.", autocompletion=_complete_program
    ),
]
ZeroOption = Annotated[
    list[str] | None,
    typer.Option(
        "--zero",
        metavar="X=10,Y=20",
        help="Where the program's zero lies, in G54 or as G55:X=10 [mm, deg]; R=30 turns it; repeatable.",
    ),
]
BlockDeleteOption = Annotated[
    bool, typer.Option("--block-delete", help="Skip lines that begin with /, as with that switch on.")
]
OptionalStopOption = Annotated[
    bool, typer.Option("--optional-stop/--no-optional-stop", help="Whether M01 is a pause.")
]
JsonOption = Annotated[bool, typer.Option("--json", help="Answer with one JSON object on standard output.")]
ConnectOption = Annotated[
    list[str] | None,
    typer.Option(
        "--connect",
        "-c",
        metavar="E",
        help="Zenoh endpoint of a server or router; of several, the first reached.",
    ),
]
ZenohConfigOption = Annotated[
    Path | None,
    typer.Option("--zenoh-config", metavar="PATH", help="A Zenoh configuration (JSON5) for TLS."),
]
HostOption = Annotated[str, typer.Option("--host", help="Address that is listened on.")]
PortOption = Annotated[int, typer.Option("--port", min=0, max=65535, help="0: a free one.")]
StatesRateOption = Annotated[
    float, typer.Option("--rate", min=0.1, max=20.0, help="States a second of each machine.")
]
CertificateOption = Annotated[
    Path | None, typer.Option("--certificate", metavar="PEM", help="Serve with TLS; needs --key.")
]
KeyOption = Annotated[Path | None, typer.Option("--key", metavar="PEM", help="The certificate's key.")]
DEFAULT_MACHINE = "cartesian"
