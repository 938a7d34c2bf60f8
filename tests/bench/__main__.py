"""``make bench``: every figure beside a floor of the same run; ``make bench ARGS="parsing squares"``: some.

Decides nothing: the exit code is 0 whatever the figures are. What this computer lacks is said and left out.
"""

from __future__ import annotations

import importlib
import os
import platform
import sys
from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

from tests.bench.figures import Figure, NotAvailable

SECTIONS = {
    "parsing": "parse and interpret",
    "real_files": "files in the manner of ten posts, beside LinuxCNC",
    "planning": "parse … lookahead … setpoints",
    "squares": "a 100 mm square",
    "five_axes": "an S-shaped wall on five axes",
    "polylines": "polylines that stand for an arc",
    "simulate": "simulation against the machine's time",
    "clearance": "clearance of all bodies, a cycle",
    "gait": "a line of four legs",
    "override": "an override above 100 %",
    "executor_cycle": "the cycle's body",
    "servo": "servo mode beside Ruckig",
    "can_cycle": "an exchange with CAN drives",
    "ethercat_cycle": "an exchange with EtherCAT drives",
    "ethercat_mailbox": "late cycles beside a mailbox",
    "canopen_boot": "eight CANopen drives, from nothing to operational",
    "wake_up": "waking up once a millisecond",
    "first_motion": "submit → first motion",
    "round_trip": "submit → acknowledgement",
    "crowd": "status beside 50 subscribers and 10 streams",
    "fleet": "fleets of light machines behind routers",
    "telemetry": "telemetry of 64 axes at 1 kHz",
    "recorder": "the recorder with 64 axes at 1 kHz",
    "instruments": "what the field's instruments cost beside the cycle",
    "page": "the operator's page with viewers",
    "page_age": "how old is what the operator's page shows",
    "sdks": "the SDKs of all languages",
}


def main(chosen: Sequence[str]) -> int:
    """Run the chosen sections (all without a choice) and print their tables."""
    unknown = [name for name in chosen if name not in SECTIONS]
    if unknown:
        print(f"no such section: {', '.join(unknown)}; there are {', '.join(SECTIONS)}", file=sys.stderr)
        return 2
    console = Console(highlight=False, width=None if sys.stdout.isatty() else 140)
    console.print(
        f"{platform.machine()}, {os.cpu_count()} CPUs, Python {platform.python_version()}, "
        f"Linux {platform.release()}"
    )
    for name in chosen or SECTIONS:
        console.print(f"\n[bold]{SECTIONS[name]}[/bold] ({name})")
        try:
            figures = importlib.import_module(f"tests.bench.{name}").measure()
        except NotAvailable as reason:
            console.print(f"  not available: {reason}")
        except Exception as error:  # one broken section must not cost the others
            console.print(f"  not available: {type(error).__name__}: {error}", markup=False)
        else:
            console.print(table_of(figures))
    return 0


def table_of(figures: Sequence[Figure]) -> Table:
    """One section's figures."""
    table = Table(box=None, pad_edge=True, header_style="dim")
    table.add_column("what", min_width=40)
    table.add_column("measured", justify="right", no_wrap=True)
    table.add_column("floor", justify="right", no_wrap=True)
    table.add_column("ratio", justify="right", no_wrap=True)
    table.add_column("the floor is")
    table.add_column("goal")
    for figure in figures:
        table.add_row(
            figure.what,
            f"{_shown(figure.measured)} {figure.unit}",
            "" if figure.floor is None else f"{_shown(figure.floor)} {figure.unit}",
            "" if figure.ratio is None else f"{figure.ratio:.3f}",
            figure.against,
            figure.goal,
        )
    return table


def _shown(value: float) -> str:
    if abs(value) >= 10_000:
        return f"{value:,.0f}".replace(",", "\u2009")
    return f"{value:.4g}"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
