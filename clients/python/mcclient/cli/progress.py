"""Progress of a run on standard error: a live bar on a terminal, a plain line now and then elsewhere."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from rich.console import Group, RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from mcclient.cli.output import say
from mcclient.cli.tables import STATE_STYLES
from mcclient.cli.terminal import TerminalConsole
from mcclient.types import ENDED

PLAIN_EVERY_S = 5.0
REFRESH_HZ = 10
BAR_COLUMNS = 36
LEAST_BAR_COLUMNS = 8
NAME_COLUMNS = 24


@dataclass(frozen=True, slots=True)
class Snapshot:
    """How far a run is.

    Attributes:
        first, total: numbers of the first and the last line; total None: not known.
        line: the line under way. done: the last one that has ended.
        planned_s: until the end of what is planned [s]; None: not known.
        remaining_s: until the program's end, by its simulation [s]. share: of its time that has passed.
        notice: what the program said last to its operator.
        simulated: share of the lines that the simulation has reached; below 1 the times are estimates.
        pauses: lines to come that wait for an operator; their waits are not in the times.
        elapsed_s: for how long its lines have run, without holds, pauses, waits for inputs and the way to the
            first one.
        waits_for: the input, or the program, that it waits for; empty: for none.
        behind: the programs that have the axes, and which; empty: it waits for none.
        online: the server is there.
    """

    state: str
    first: int
    total: int | None
    line: int
    done: int
    text: str
    override: float
    elapsed_s: float
    planned_s: float | None = None
    behind: str = ""
    online: bool = True
    remaining_s: float | None = None
    share: float | None = None
    notice: str = ""
    simulated: float = 1.0
    pauses: int = 0
    waits_for: str = ""

    @property
    def shown_state(self) -> str:
        """What is to be known first: a server that is gone, what is waited for, else the state."""
        if not self.online and self.state not in ENDED:
            return "the server is gone"
        if self.state == "paused" and self.notice:
            return f"paused: {self.notice}"
        if self.state == "running" and self.waits_for:
            return f"waits for {self.waits_for}"
        if self.state == "held" and self.waits_for:
            return f"held by {self.waits_for}"
        return f"queued behind {self.behind}" if self.state == "queued" and self.behind else self.state

    @property
    def fraction(self) -> float | None:
        """Share of the program's time that has passed; of its lines where the times are not known."""
        if self.share is not None:
            return self.share
        if self.total is None or self.total < self.first:
            return None
        return min(1.0, max(0.0, (self.done - self.first + 1) / (self.total - self.first + 1)))

    @property
    def eta_s(self) -> float | None:
        """By the program's simulation; without one by the lines done so far, and at least what is planned."""
        if self.remaining_s is not None:
            return self.remaining_s
        fraction = self.fraction
        by_lines = None
        if fraction is not None and fraction > 0.0:
            by_lines = self.elapsed_s * (1.0 - fraction) / fraction
        known = [value for value in (by_lines, self.planned_s) if value is not None]
        return max(known) if known else None


class Display(Protocol):
    """Shows snapshots until it is stopped; may be paused for a question."""

    def start(self) -> None: ...
    def stop(self) -> None: ...
    def update(self, snapshot: Snapshot, /) -> None: ...


def duration(seconds: float | None) -> str:
    """``1:05``, ``2:03:04``; ``-`` where it is not known."""
    if seconds is None:
        return "-"
    whole = int(seconds + 0.5)
    minutes, rest = divmod(whole, 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


def eta_text(snapshot: Snapshot) -> str:
    """``1:05``, ``about 1:05 (12 % simulated)``, ``1:05 + 2 pauses``; unsimulated ``about 1:05`` by the lines
    done, ``at least 0:05`` where only what is planned is known."""
    shown = duration(snapshot.eta_s)
    if snapshot.eta_s is None:
        return shown
    if snapshot.remaining_s is None:
        return f"about {shown}" if snapshot.fraction else f"at least {shown}"
    if snapshot.simulated < 1.0:
        shown = f"about {shown} ({100.0 * snapshot.simulated:.0f} % simulated)"
    if snapshot.pauses:
        shown += f" + {snapshot.pauses} pause{'s' * (snapshot.pauses != 1)}"
    return shown


def count_of(snapshot: Snapshot) -> str:
    return f"{snapshot.line}/{snapshot.total}" if snapshot.total is not None else f"{snapshot.line}"


class LiveDisplay:
    """A bar with the line under way below it."""

    def __init__(self, console: TerminalConsole, name: str) -> None:
        self._console = console
        self._name = name
        self._live: Live | None = None
        self._last: RenderableType = Text("")

    def start(self) -> None:
        self._live = Live(
            self._last,
            console=self._console,
            refresh_per_second=REFRESH_HZ,
            transient=True,
            auto_refresh=False,
        )
        self._live.start()

    def stop(self) -> None:
        live, self._live = self._live, None
        if live is not None:
            live.stop()

    def update(self, snapshot: Snapshot) -> None:
        self._last = self._view(snapshot)
        if self._live is not None:
            self._live.update(self._last, refresh=True)

    def _view(self, snapshot: Snapshot) -> RenderableType:
        fraction = snapshot.fraction
        name = Text(self._name, style="bold", no_wrap=True)
        name.truncate(NAME_COLUMNS, overflow="ellipsis")
        facts = Text.assemble(
            "" if fraction is None else f"{100.0 * fraction:3.0f} %  ",
            f"line {count_of(snapshot)}  ETA {eta_text(snapshot)}  {snapshot.override:g} %  ",
            Text(
                snapshot.shown_state,
                style=STATE_STYLES.get(snapshot.state, "") if snapshot.online else "bold red",
            ),
        )
        room = self._console.width - name.cell_len - facts.cell_len - 6
        bar = ProgressBar(
            total=1.0,
            completed=fraction or 0.0,
            width=max(LEAST_BAR_COLUMNS, min(BAR_COLUMNS, room)),
            pulse=fraction is None and snapshot.state == "running",
        )
        row = Table.grid(padding=(0, 2))
        row.add_row(name, bar, facts)
        text = Text(f"{snapshot.line:>6} | {snapshot.text}", style="dim", no_wrap=True, overflow="ellipsis")
        return Group(row, text)


class PlainDisplay:
    """A line when the state changes, and now and then."""

    def __init__(
        self, name: str, *, every_s: float = PLAIN_EVERY_S, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._name = name
        self._every_s = every_s
        self._clock = clock
        self._said_at = float("-inf")
        self._state = ""

    def start(self) -> None:
        """Nothing is held open."""

    def stop(self) -> None:
        """Nothing is held open."""

    def update(self, snapshot: Snapshot) -> None:
        now = self._clock()
        if snapshot.shown_state == self._state and now - self._said_at < self._every_s:
            return
        self._said_at, self._state = now, snapshot.shown_state
        fraction = snapshot.fraction
        percent = "" if fraction is None else f" {100.0 * fraction:.0f} %"
        eta = "" if snapshot.eta_s is None else f", ETA {eta_text(snapshot)}"
        say(
            f"{self._name}: {snapshot.shown_state}, line {count_of(snapshot)}{percent}{eta}, "
            f"override {snapshot.override:g} %"
        )


class NoDisplay:
    """In single line mode each step has a sentence of its own."""

    def start(self) -> None:
        """Nothing is shown."""

    def stop(self) -> None:
        """Nothing is shown."""

    def update(self, _snapshot: Snapshot) -> None:
        """Nothing is shown."""
