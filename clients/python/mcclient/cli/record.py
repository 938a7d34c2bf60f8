"""``mcctl record``: recordings on the server, and straight from telemetry into a file here."""

from __future__ import annotations

import asyncio
import contextlib
import enum
import os
import time
from collections.abc import Awaitable, Callable, Sequence
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any

import msgspec
import typer
from rich.table import Table
from rich.text import Text

from mcclient.cli.dataset import dataset
from mcclient.cli.options import JsonOption, Target, with_target
from mcclient.cli.output import results, say, write_json
from mcclient.cli.signals import on_signals
from mcclient.cli.tables import plain_table
from mcclient.errors import RequestRefused
from mcclient.machine import Machine
from mcclient.sample_file import open_sample_file
from mcclient.types import RecordingInfo, RecordingsReply

SUFFIX = ".mcap"
NameArgument = Annotated[str, typer.Argument(metavar="[NAME]", help="Of the recording.")]
OutputOption = Annotated[
    Path | None, typer.Option("--output", "-o", metavar="FILE", help="Where to; default: its name, here.")
]


class Format(enum.StrEnum):
    """What ``mcctl record`` writes here."""

    PARQUET = "parquet"
    CSV = "csv"
    NPZ = "npz"


def build_app() -> typer.Typer:
    """Return the commands ``mcctl record …``."""
    app = typer.Typer(help="Record cycles: on the server, or here with --output.", no_args_is_help=False)
    app.callback(invoke_without_command=True)(with_target(record))
    app.command("start")(with_target(start))
    app.command("stop")(with_target(stop))
    app.command("save")(with_target(save))
    app.command("list")(with_target(list_))
    app.command("get")(with_target(get))
    app.command("dataset")(dataset)
    return app


def record(
    target: Target,
    context: typer.Context,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="Record telemetry into a file here: .parquet, .csv or .npz; Ctrl-C ends it.",
        ),
    ] = None,
    format: Annotated[
        Format | None,
        typer.Option("--format", "-f", help="Of the file; its name is MACHINE-TIME.FORMAT without --output."),
    ] = None,
    seconds: Annotated[
        float | None, typer.Option("--seconds", "-s", min=0.0, help="How long; default: until Ctrl-C.")
    ] = None,
    json: JsonOption = False,
) -> None:
    """Record cycles: on the server (start, stop, save, list, get), or here with --output."""
    if context.invoked_subcommand is not None:
        return
    if output is None and format is None:
        raise typer.BadParameter("give --output FILE or --format, or one of start, stop, save, list, get")
    if output is not None and format is not None and output.suffix.lower() not in ("", f".{format}"):
        raise typer.BadParameter(f"{output} is not called as a file of the format {format}")

    async def work(one: Machine) -> dict[str, Any]:
        return await _record_here(one, _file_name(output, format, one.name, time.time()), seconds)

    found = target.carry_out(work, json)
    if json:
        write_json({"ok": True, **found})
    else:
        lost = f", {found['lost']} lost on the way" if found["lost"] else ""
        say(f"{found['output']}: {found['cycles']} cycles{lost}")


def _file_name(output: Path | None, format: Format | None, machine: str, now: float) -> Path:
    """Return the file to write; ``now``: Unix time [s]."""
    if output is None:
        when = time.strftime("%Y%m%dT%H%M%SZ", time.gmtime(now))
        return Path(f"{machine}-{when}.{format}")
    return output if format is None or output.suffix else output.with_name(f"{output.name}.{format}")


async def _record_here(machine: Machine, output: Path, seconds: float | None) -> dict[str, Any]:
    if not output.resolve().parent.is_dir():
        raise RequestRefused("MC511", f"{output} cannot be written: there is no such folder", "make it first")
    try:
        file = open_sample_file(output, machine.info)
    except OSError as error:
        raise RequestRefused(
            "MC511", f"{output} cannot be written: {error.strerror}", "choose another"
        ) from error
    cycles, lost, expected = 0, 0, None
    ended = asyncio.Event()
    stop_signals = _on_interrupt(ended)
    say(f"recording {machine.name} into {output}; Ctrl-C ends it")

    async def take() -> None:
        nonlocal cycles, lost, expected
        async for samples in machine.samples():
            if expected is not None and samples.seq > expected:
                lost += samples.seq - expected
            expected = samples.seq + len(samples.time_s)
            cycles += len(samples.time_s)
            file.append(samples)

    taking = asyncio.ensure_future(take())
    taking.add_done_callback(lambda _: ended.set())
    try:
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(ended.wait(), seconds)
    finally:
        stop_signals()
        taking.cancel()
        outcome = (await asyncio.gather(taking, return_exceptions=True))[0]
    try:
        file.finish()
    except OSError as error:
        raise RequestRefused("MC511", f"{output} could not be written: {error}", "make room") from error
    if isinstance(outcome, OSError):
        raise RequestRefused("MC511", f"{output} could not be written: {outcome}", "make room") from outcome
    return {"output": str(output), "cycles": cycles, "lost": lost}


def _on_interrupt(ended: asyncio.Event) -> Callable[[], None]:
    import signal

    try:
        return on_signals((signal.SIGINT, signal.SIGTERM), ended.set)
    except (RuntimeError, ValueError):
        # not in the main thread
        return lambda: None


def start(
    target: Target,
    name: NameArgument = "",
    seconds: Annotated[
        float | None, typer.Option("--seconds", "-s", min=0.001, max=86_400.0, help="End it after this time.")
    ] = None,
    json: JsonOption = False,
) -> None:
    """Record every cycle into a file on the server from now on."""
    _order("recording", json, target, lambda one: one.record_start(name, max_s=seconds))


def stop(target: Target, name: NameArgument = "", json: JsonOption = False) -> None:
    """End a recording on the server; without a name the only one."""
    _order("written", json, target, lambda one: one.record_stop(name))


def save(
    target: Target,
    reason: Annotated[str, typer.Option("--reason", help="Stands in the file and in its name.")] = "asked",
    json: JsonOption = False,
) -> None:
    """Write out the black box, the last minutes, on the server."""
    _order("written", json, target, lambda one: one.record_save(reason))


def _order(word: str, json: bool, target: Target, order: Callable[[Machine], Awaitable[str]]) -> None:
    async def work(one: Machine) -> tuple[str, str]:
        return one.name, await order(one)

    machine, name = target.carry_out(work, json)
    if json:
        write_json({"ok": True, "machine": machine, "recording": name})
    else:
        say(f"{machine}: {name} {word}")


def list_(target: Target, json: JsonOption = False) -> None:
    """List the recordings on the server, and what the black box holds."""

    async def work(one: Machine) -> tuple[str, RecordingsReply]:
        return one.name, await one.recordings()

    name, found = target.carry_out(work, json)
    if json:
        write_json({"ok": True, "machine": name, **msgspec.to_builtins(found)})
        return
    if found.recordings:
        results().print(recordings_table(found.recordings))
    recorder = found.recorder
    if recorder is None:
        say(f"{name}: no recorder runs", "yellow")
    else:
        held = f"{recorder.held_s:.1f} s in {recorder.held_bytes / 1e6:.1f} MB"
        missed = f"; {recorder.missed_cycles} cycles missed" if recorder.missed_cycles else ""
        say(f"{name}: the black box holds {held}{missed}")


def recordings_table(recordings: Sequence[RecordingInfo]) -> Table:
    """Return a row for each recording, the newest first."""
    table = plain_table()
    for title, justify in (("name", "left"), ("state", "left"), ("size", "right"), ("written", "left")):
        table.add_column(title, overflow="fold", justify=justify)  # type: ignore[arg-type]
    for each in recordings:
        at = datetime.fromtimestamp(each.modified_at).astimezone().isoformat(" ", "seconds")
        table.add_row(Text(each.name), each.state, f"{each.size / 1e6:.1f} MB", at)
    return table


def get(
    target: Target,
    name: Annotated[str, typer.Argument(metavar="[NAME]", help="Left out: the newest.")] = "",
    output: OutputOption = None,
    json: JsonOption = False,
) -> None:
    """Take a recording over from the server into a file here."""

    async def work(one: Machine) -> tuple[str, Path, int]:
        chosen = name.removesuffix(SUFFIX) or await _newest(one)
        file = output or Path(f"{chosen}{SUFFIX}")
        return chosen, file, await _download(one, chosen, file)

    chosen, file, size = target.carry_out(work, json)
    if json:
        write_json({"ok": True, "recording": chosen, "output": str(file), "size": size})
    else:
        say(f"{file}: {size / 1e6:.1f} MB")


async def _newest(machine: Machine) -> str:
    done = [each.name for each in (await machine.recordings()).recordings if each.state == "done"]
    if not done:
        raise RequestRefused("MC585", f"{machine.name} has no recording", "mcctl record save makes one")
    return str(done[0])


async def _download(machine: Machine, name: str, target: Path) -> int:
    partial = target.with_name(f".{target.name}.{os.getpid()}.part")
    size = 0
    try:
        with partial.open("wb") as stream:
            shown_at = time.monotonic()
            async for part, whole in machine.read_recording(name):
                stream.write(part)
                size += len(part)
                if time.monotonic() - shown_at > 1.0:
                    shown_at = time.monotonic()
                    say(f"{name}: {100.0 * size / max(whole, 1):.0f} % of {whole / 1e6:.1f} MB")
        os.replace(partial, target)
    except OSError as error:
        raise RequestRefused(
            "MC511", f"{target} cannot be written: {error.strerror}", "give --output"
        ) from error
    finally:
        partial.unlink(missing_ok=True)
    return size
