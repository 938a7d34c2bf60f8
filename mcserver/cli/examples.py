"""``mcserver examples``: the programs that come with the package."""

from __future__ import annotations

import operator
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Annotated

import typer

from mcserver.cli.console import json_answer_on_error, narration, results, write_json, write_text
from mcserver.cli.options import JsonOption
from mcserver.cli.output_file import write_atomically
from mcserver.errors import UsageFault


def examples_folder() -> Traversable:
    """Return the folder of the examples: in the installed package, or beside the sources."""
    packaged = resources.files("mcserver").joinpath("examples")
    return packaged if packaged.is_dir() else Path(__file__).parents[2] / "examples"


def example_programs() -> dict[str, Traversable]:
    """Return the programs by name, without their suffix."""
    suffix = ".gcode"
    files = (each for each in examples_folder().iterdir() if each.name.endswith(suffix))
    return {each.name.removesuffix(suffix): each for each in sorted(files, key=lambda each: each.name)}


def examples(
    name: Annotated[
        str | None, typer.Argument(metavar="[NAME]", help="Print this one; without it, list them.")
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="DIR", help="Write it, or all of them, into a folder."),
    ] = None,
    json: JsonOption = False,
) -> None:
    """List the example programs, print one, or write them into a folder."""
    with json_answer_on_error(json, {"ok": False}):
        programs = example_programs()
        if name is not None:
            wanted = name.removesuffix(".gcode")
            if wanted not in programs:
                raise UsageFault(
                    "MC017",
                    f"there is no example {name!r}",
                    f"there are {', '.join(programs)}; -o FOLDER writes all",
                )
            programs = {wanted: programs[wanted]}
        texts = {each: file.read_bytes() for each, file in programs.items()}
        written = write_all(output, texts) if output is not None else {}
    if json:
        shown = {each: {"title": title(text), "file": written.get(each)} for each, text in texts.items()}
        write_json({"ok": True, "examples": shown})
    elif output is not None:
        for file in written.values():
            narration().print(file)
    elif name is not None:
        write_text(next(iter(texts.values())).decode("utf-8"))
    else:
        width = max(map(len, texts))
        for each, text in texts.items():
            results().print(f"{each:{width}}  {title(text)}")


def write_all(folder: Path, texts: dict[str, bytes]) -> dict[str, str]:
    """Write programs into a folder, which is made; return their files by name."""
    folder.mkdir(parents=True, exist_ok=True)
    written = {}
    for name, text in texts.items():
        file = str(folder / f"{name}.gcode")
        write_atomically(file, operator.methodcaller("write", text))
        written[name] = file
    return written


def title(program: bytes) -> str:
    """Return what the first comment of a program says."""
    for line in program.decode("utf-8").splitlines():
        if line.startswith(";"):
            return line.lstrip("; ").rstrip()
    return ""
