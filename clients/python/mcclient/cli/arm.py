"""``mcctl arm``: what waits for an operator, with its text and picture, and the order that lets it start."""

from __future__ import annotations

import math
import os
import sys
from pathlib import Path
from typing import Annotated, Any

import msgspec
import typer
from rich.table import Table
from rich.text import Text

from mcclient.cli.options import JsonOption, Target
from mcclient.cli.output import narration, results, say, write_json
from mcclient.cli.tables import plain_table
from mcclient.cli.terminal import show_diagnostics
from mcclient.errors import RequestRefused
from mcclient.machine import Machine
from mcclient.run_picture import axis_label, run_picture
from mcclient.switches import switches_said
from mcclient.types import Diagnostic, RunRequestStatus

SHOWN_HASH = 12
WAITS, ARMED = "waiting", "armed"


def arm(
    target: Target,
    sha256: Annotated[
        str | None,
        typer.Argument(metavar="[HASH]", help="Of the text, at least 8 digits; left out: list what waits."),
    ] = None,
    seconds: Annotated[
        float, typer.Option("--seconds", "-s", min=1.0, max=3600.0, help="How long it may be started.")
    ] = 60.0,
    override: Annotated[
        float, typer.Option("--override", min=1.0, max=200.0, help="The greatest feed override, in percent.")
    ] = 100.0,
    standing: Annotated[
        float,
        typer.Option(
            "--standing",
            min=0.0,
            max=3600.0,
            metavar="SECONDS",
            help="For so long, whatever else its client asks for inside of this envelope is armed too: "
            "any text, with any block delete and optional stop.",
        ),
    ] = 0.0,
    servo: Annotated[
        bool,
        typer.Option("--servo", help="With --standing: its client may stream targets inside of it, too."),
    ] = False,
    show: Annotated[bool, typer.Option("--show", help="Print its text and extents; arm nothing.")] = False,
    reject: Annotated[
        str | None, typer.Option("--reject", metavar="REASON", help="Say no, and why; who asked reads it.")
    ] = None,
    withdraw: Annotated[bool, typer.Option("--withdraw", help="Take back what you asked for.")] = False,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Do not ask at a terminal.")] = False,
    pictures: Annotated[
        Path | None,
        typer.Option("--pictures", metavar="FOLDER", help="Where pictures go; default: the user's cache."),
    ] = None,
    json: JsonOption = False,
) -> None:
    """Arm a program that somebody asked to run: this very text, once; without a hash, list what waits.

    Every run that waits is drawn as it was simulated, in a file that is named.
    """

    approved: list[dict[str, Any]] = []

    async def look(one: Machine) -> tuple[str, list[dict[str, Any]]]:
        folder = pictures or default_folder() / one.name
        wanted = msgspec.to_builtins(await one.run_requests())
        approved.extend(msgspec.to_builtins(await one.run_approvals()))
        if pictures is None:
            forget_others(folder, wanted)
        if sha256 is not None:
            wanted = [each for each in wanted if each["sha256"].startswith(sha256.lower())]
        return one.name, [await shown(one, each, folder) for each in wanted]

    async def order(one: Machine, number: int | None) -> dict[str, Any]:
        if reject is not None:
            return _plain(await one.reject(sha256 or "", reject, number=number))
        return _plain(
            await one.arm(
                sha256 or "",
                seconds=seconds,
                override=override,
                number=number,
                standing_s=standing,
                servo=servo,
            )
        )

    async def take_back(one: Machine) -> list[dict[str, Any]]:
        return [_plain(each) for each in await one.withdraw(sha256 or "")]

    if (withdraw or reject is not None) and (sha256 is None or (withdraw and reject is not None)):
        raise typer.BadParameter("name one request by its hash, and either --reject or --withdraw")
    if servo and not standing:
        raise typer.BadParameter("--servo needs --standing: targets are approved for a while")
    name, found = target.carry_out(look, json)
    if withdraw:
        left = target.carry_out(take_back, json)
        if json:
            write_json({"ok": True, "machine": name, "requests": left})
        else:
            say(f"{name}: {sha256} is withdrawn")
        return
    if sha256 is None or show:
        if json:
            write_json({"ok": True, "machine": name, "requests": found, "approvals": approved})
        elif not found and not approved:
            say(f"{name}: nothing waits for an operator")
        elif show:
            for each in found:
                print_run(each)
        else:
            for each in approved:
                left, limit = math.ceil(each["remaining_s"]), f"{each['override']:g} %"
                what = "run, and stream targets for," if each["servo"] else "run"
                say(
                    f"{name}: {each['client']} may {what} what stays inside of {each['sha256'][:SHOWN_HASH]} "
                    f"for another {left} s, up to {limit} (by {each['operator']}; --reject ends it)"
                )
            if found:
                results().print(requests_table(found))
        return
    seen = [
        each for each in found if each["state"] == WAITS or (reject is not None and each["state"] == ARMED)
    ]
    asked = not yes and sys.stdin.isatty()
    if len(seen) == 1 and reject is None and not json and not asked:
        print_warnings(seen[0])
    if len(seen) == 1 and reject is None and not json and asked:
        print_run(seen[0])
        streams = ", targets that no simulation shows, too" if servo else ""
        more = f" And for {standing:g} s all that stays inside of it{streams}?" if standing else ""
        if not typer.confirm(f"Arm it once, for {seconds:g} s, with at most {override:g} %?{more}", err=True):
            say("nothing is armed")
            raise typer.Exit(1)
    # what was looked at, and nothing that was asked for in its place since
    armed = target.carry_out(lambda one: order(one, seen[0]["number"] if len(seen) == 1 else None), json)
    picture = seen[0]["picture"] if len(seen) == 1 else None
    if json:
        write_json({"ok": True, "machine": name, "requests": [{**armed, "picture": picture}]})
    else:
        results().print(requests_table([{**armed, "picture": picture}]))


def _plain(run: RunRequestStatus) -> dict[str, Any]:
    return dict(msgspec.to_builtins(run))


async def shown(machine: Machine, run: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return a request with its text, and with the file of its picture, drawn now."""
    try:
        preview = msgspec.to_builtins(await machine.run_preview(run["sha256"]))
    except RequestRefused:
        # over since it was listed
        return {**run, "text": "", "picture": None, "warnings": [], "unshown_warnings": 0}
    seen = {key: preview[key] for key in ("text", "warnings", "unshown_warnings")}
    file = folder / picture_name(run)
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        file.write_text(run_picture(preview), "utf-8")
    except OSError as error:
        say(f"no picture: {error}")
        return {**preview["run"], **seen, "picture": None}
    return {**preview["run"], **seen, "picture": str(file)}


def picture_name(run: dict[str, Any]) -> str:
    """Return the file of a request's picture."""
    return f"{run['sha256'][:SHOWN_HASH]}.svg"


def default_folder() -> Path:
    """``mcctl/arm`` in the user's cache folder, which has a folder for each machine."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "mcctl" / "arm"


def forget_others(folder: Path, wanted: list[dict[str, Any]]) -> None:
    """Remove the pictures of requests that are over: the folder would grow otherwise."""
    kept = {picture_name(each) for each in wanted}
    for file in folder.glob("*.svg") if folder.is_dir() else ():
        if file.name not in kept:
            file.unlink(missing_ok=True)


def requests_table(requests: list[dict[str, Any]]) -> Table:
    """Build a row for each request; names are shown as they are, without control characters."""
    table = plain_table()
    for title in ("hash", "state", "client", "name", "moves", "lasts", "left", "override", "picture"):
        # a path that is read by another program is one line
        table.add_column(title, overflow="fold", no_wrap=title == "picture" and not results().is_terminal)
    for each in requests:
        cells = (
            each["sha256"][:SHOWN_HASH],
            each["state"],
            each["client"],
            each["name"],
            "; ".join(_extents(each)),
            f"{each['duration_s']:.3f} s",
            f"{math.ceil(each['remaining_s'])} s",
            f"{each['override']:g} %",
            each.get("picture") or "",
        )
        table.add_row(*(Text(cell) for cell in cells))
    return table


def print_run(run: dict[str, Any]) -> None:
    """Print all that an operator has to see of one run: who asks, the text, how far and how long."""
    console = narration()
    name = f" {run['name']!r}" if run["name"] else ""
    which = f"{run['sha256'][:SHOWN_HASH]}, {run['state']}"
    console.print(Text(f"{run['client']} asks for{name} ({which})"))
    for number, line in enumerate(run["text"].splitlines(), 1):
        console.print(Text(f"{number:6} | {line}"))
    print_warnings(run)
    for extent in (*_extents(run), *_tools(run)):
        console.print(Text(f"  {extent}"))
    for switched in switches_said(run["block_delete"], run["optional_stop"]):
        console.print(Text(f"  {switched}"))
    for effect in run.get("effects", []):
        console.print(Text(f"  afterwards, for every later program, it {effect}"))
    for each in run.get("beyond", []):
        console.print(Text(f"  outside of what is approved for a while: {each}"))
    for change in run.get("changed", []):
        console.print(Text(f"  cannot start as it was simulated: {change}"))
    console.print(Text(f"  lasts {run['duration_s']:.3f} s"))
    if run["picture"]:
        console.print(Text(f"  picture: {run['picture']}"))


def print_warnings(run: dict[str, Any]) -> None:
    """Print what its check and simulation warn of, each with its line."""
    lines = dict(enumerate(run["text"].splitlines(), 1))
    show_diagnostics(msgspec.convert(run["warnings"], list[Diagnostic]), lines.get, run["name"] or "text")
    if run["unshown_warnings"]:
        narration().print(Text(f"… and {run['unshown_warnings']} warnings more"))


def _extents(run: dict[str, Any]) -> list[str]:
    return [
        f"axis {axis_label(part['axis'])}: "
        + ("turns" if part.get("turns") else f"{part['low']:.3f} … {part['high']:.3f} {part['unit']}")
        + (f", up to {part['speed']:.1f} {part['unit']}/s" if "speed" in part else "")
        for part in run["extents"]
    ]


def _tools(run: dict[str, Any]) -> list[str]:
    return [
        f"tool {tool['tool']}: "
        + ", ".join(
            f"{letter} {low:.3f} … {high:.3f}"
            for letter, low, high in zip("XYZ", tool["low"], tool["high"], strict=True)
        )
        + f" mm, up to {tool['speed']:.1f} mm/s"
        for tool in run.get("tools", [])
    ]
