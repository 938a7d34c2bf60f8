"""What the scopes of a desk share: how long they record, and a trace as a picture and as MCAP."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence

from nicegui import ui

from mcserver.canopen.scope import ScopeTrace
from mcserver.web.sample_scope import drawn_rows
from mcserver.web.translation import t

SPANS_S = (0.5, 1.0, 2.0, 5.0, 10.0)


def span_choice() -> ui.select:
    """Add the choice of how long is recorded [s]."""
    made = ui.select({each: f"{each:g} s" for each in SPANS_S}, value=2.0, label=t("Span"))
    return made.props("dense").classes("w-20")


def draw_trace(
    chart: ui.echart, trace: ScopeTrace, columns: list[int], names: Sequence[str], units: Sequence[str]
) -> None:
    """Draw some columns of a trace; those of one unit share a picture.

    Args:
        names, units: of these columns.
    """
    message = {
        "names": names,
        "units": units,
        "steps": [False] * len(columns),
        "span": float(trace.time_s[-1] - trace.time_s[0]) if len(trace.time_s) else 0.0,
        "rows": drawn_rows(trace, columns),
        "restart": True,
        "zero": 0,
    }
    ui.run_javascript(f"mcChart({chart.id}, {json.dumps(message)})")


def download_trace(trace: ScopeTrace, machine: str, zero_unix: float, suffix: str = "") -> None:
    """Give the browser a trace as MCAP; ``zero_unix``: its time 0 [s]."""
    # Protobuf and MCAP are loaded when somebody wants a file
    from mcserver.recorder.scope_file import write_scope

    stream = io.BytesIO()
    write_scope(stream, trace, machine, zero_unix)
    ui.download.content(stream.getvalue(), f"{machine}-axis-{trace.axis}{suffix}.mcap")
