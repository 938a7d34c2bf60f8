"""``mcctl fleet``: every machine in one table, and orders to many, with a question first."""

from __future__ import annotations

import asyncio
import contextlib
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import typer
from rich.live import Live
from rich.table import Table
from rich.text import Text

from mcclient.cli.options import LOOK_S, ConfigOption, ConnectOption, JsonOption
from mcclient.cli.output import as_plain, carry_out, error_as_json, errors_shown, results, say, write_json
from mcclient.cli.tables import plain_table, state_text
from mcclient.cli.terminal import TerminalConsole
from mcclient.errors import MotionError, NobodyAnswers, RequestRefused
from mcclient.estop import emergency_stop
from mcclient.fleet import FleetLink
from mcclient.transport import endpoints_of
from mcclient.types import MachineStatus

FAILED = 1
ANSWER_S = 1.0
ORDERS = {"hold": "hold", "resume": "resume", "abort": "abort", "estop": "stop by emergency stop"}

NamesArgument = Annotated[
    list[str] | None, typer.Argument(metavar="NAME…", help="The machines; default: all that are there.")
]
YesOption = Annotated[bool, typer.Option("--yes", "-y", help="Do not ask.")]


def build_app() -> typer.Typer:
    """``mcctl fleet`` shows; its sub-commands give orders."""
    app = typer.Typer(help="All machines: a table, and orders to many.", invoke_without_command=True)
    app.callback()(show)
    for method, words in ORDERS.items():
        app.command(method, help=f"{words.capitalize()} the machines named, or all.")(_order_command(method))
    return app


def show(
    context: typer.Context,
    connect: ConnectOption = None,
    rate: Annotated[
        float, typer.Option("--rate", metavar="HZ", min=1.0, max=10.0, help="States a second.")
    ] = 2.0,
    once: Annotated[bool, typer.Option("--once", help="Show one table and leave.")] = False,
    zenoh: ConfigOption = None,
    json: JsonOption = False,
) -> None:
    """All machines in one table, live; Ctrl-C leaves. With --json one line a look."""
    if context.invoked_subcommand is not None:
        return

    async def work() -> None:
        link = await FleetLink.open(connect or None, timeout_s=LOOK_S, config_file=zenoh)
        fleet = Sight(link)
        try:
            if once or not (json or results().is_terminal):
                _show(await fleet.look(), json)
                return
            console = TerminalConsole()
            live = None if json else Live(console=console, screen=True, auto_refresh=False)
            with live or contextlib.nullcontext():
                while True:
                    seen = await fleet.look()
                    if live is None:
                        _show(seen, json)
                    else:
                        live.update(table_of(seen), refresh=True)
                    await asyncio.sleep(1.0 / rate)
        finally:
            await link.close()

    with contextlib.suppress(KeyboardInterrupt):
        carry_out(work, json)


@dataclass(frozen=True, slots=True)
class Seen:
    """One machine: whether its server is there, whether it has answered now, and its last state."""

    name: str
    online: bool
    answers: bool
    status: MachineStatus | None


class Sight:
    """What has been seen of a fleet; a machine that has gone stays in it, as not online."""

    def __init__(self, link: FleetLink) -> None:
        self._link = link
        self._last: dict[str, MachineStatus | None] = {}

    async def look(self) -> list[Seen]:
        """Return every machine now, sorted by name."""
        states = await self._link.states(timeout_s=ANSWER_S)
        there = set(self._link.names)
        self._last |= {name: self._last.get(name) for name in there} | states
        return [Seen(name, name in there, name in states, self._last[name]) for name in sorted(self._last)]


def table_of(seen: Sequence[Seen]) -> Table:
    """One row a machine, those that need somebody first."""
    table = plain_table()
    for title in ("machine", "state", "program", "line", "done", "feed", "fault"):
        table.add_column(
            title, no_wrap=True, justify="right" if title in ("line", "done", "feed") else "left"
        )
    for each in sorted(seen, key=lambda each: (_urgency(each), each.name)):
        status = each.status
        program = next((one for one in status.programs if one.ended_at is None), None) if status else None
        fault = status.faults[0] if status is not None and status.faults else None
        table.add_row(
            each.name,
            _state(each),
            Text("" if program is None else program.name or program.program),
            "" if program is None else str(program.line),
            "" if program is None else f"{100.0 * program.progress:.0f} %",
            "" if status is None else f"{status.override:g} %",
            Text("" if fault is None else f"{fault.code}: {fault.message}"),
        )
    return table


def _urgency(each: Seen) -> int:
    if not each.online or each.status is None:
        return 1
    return {"estop": 0, "fault": 0}.get(each.status.state, 2)


def _state(each: Seen) -> Text:
    if not each.online:
        return Text("gone", style="bold red")
    if not each.answers or each.status is None:
        return Text("does not answer", style="bold red")
    running = next((one.state for one in each.status.programs if one.ended_at is None), None)
    return state_text(running if each.status.state == "ready" and running else each.status.state)


def _show(seen: Sequence[Seen], as_json: bool) -> None:
    if as_json:
        write_json(
            [{"machine": one.name, "online": one.online, "status": as_plain(one.status)} for one in seen]
        )
    elif seen:
        results().print(table_of(seen))
    else:
        say("no machine is there")


def _order_command(method: str) -> Callable[..., None]:
    def command(
        names: NamesArgument = None,
        connect: ConnectOption = None,
        yes: YesOption = False,
        zenoh: ConfigOption = None,
        json: JsonOption = False,
    ) -> None:
        async def work() -> dict[str, MotionError | None]:
            link = await FleetLink.open(connect or None, timeout_s=LOOK_S, config_file=zenoh)
            try:
                chosen = _chosen(await link.find(timeout_s=LOOK_S), names or ())
                if not yes and not await asyncio.to_thread(_agreed, method, chosen):
                    return {}

                async def act(name: str) -> MotionError | None:
                    try:
                        if method == "estop":
                            # on a session of its own, behind no other message
                            await emergency_stop(
                                name,
                                endpoints_of(connect),
                                client="mcctl",
                                reason="mcctl fleet",
                                config_file=zenoh,
                            )
                        else:
                            await link.order(name, method)
                    except MotionError as error:
                        return error
                    return None

                return dict(zip(chosen, await asyncio.gather(*map(act, chosen)), strict=True))
            finally:
                await link.close()

        outcome = carry_out(work, json)
        if json:
            write_json({"ok": not any(outcome.values()), "machines": _as_json(outcome)})
        else:
            for name, error in outcome.items():
                said = f"{method}" if error is None else f"error[{error.code}]: {error.message}"
                results().print(f"{name}: {said}")
        if any(outcome.values()) or not outcome:
            raise typer.Exit(FAILED)

    return command


def _as_json(outcome: dict[str, MotionError | None]) -> dict[str, Any]:
    return {name: {"ok": True} if error is None else error_as_json(error) for name, error in outcome.items()}


def _chosen(there: Sequence[str], names: Sequence[str]) -> list[str]:
    missing = sorted(set(names) - set(there))
    if missing:
        raise NobodyAnswers(
            "MC530", f"not there: {', '.join(missing)}", f"those that are: {', '.join(there) or 'none'}"
        )
    if not there:
        raise NobodyAnswers("MC530", "no machine is there", "start one: mcserver run")
    return list(dict.fromkeys(names)) or list(there)


def _agreed(method: str, names: Sequence[str]) -> bool:
    with errors_shown(False):
        if not sys.stdin.isatty():
            raise RequestRefused("MC511", "nobody can be asked here", "give --yes")
    count = f"{len(names)} machine{'s' * (len(names) != 1)}"
    say(f"{ORDERS[method]}: {count}: {', '.join(names)}", "bold")
    return input("yes or no? ").strip().lower() in ("y", "yes")
