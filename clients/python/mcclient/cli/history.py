"""``mcctl history``: questions to the Parquet files of ``mcserver history``, as SQL or ready ones."""

from __future__ import annotations

import contextlib
import importlib.util
import json as json_text
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.text import Text

from mcclient.broken_off import BY_HAND, MOVES_BY_HAND
from mcclient.cli.options import JsonOption
from mcclient.cli.output import carry_out, results, say, write_json
from mcclient.cli.tables import plain_table
from mcclient.errors import RequestRefused
from mcclient.sql_text import quoted

TABLES = ("events", "lines", "states")
# A collector that starts anew reads again what a server still has: what is one event, one line. By a window,
# below which DuckDB filters by day and machine: files of other days are not opened.
KEYS = {"events": "machine, instance, seq", "lines": "machine, program, line, start_s"}
MOST_ROWS = 1000
MOST_DAYS = 1000
# days before today
SPAN_DAYS = {"today": 0, "last week": 7, "last month": 30}
SPANS = {
    "today": "day = current_date",
    "last week": "time >= now()::TIMESTAMP - INTERVAL 7 DAY",
    "last month": "time >= now()::TIMESTAMP - INTERVAL 30 DAY",
    "": "true",
}
# programs that have ended, with their names and when they began
_RUNS = (
    "(SELECT * FROM events WHERE kind = 'program.ended' AND {span})"
    " LEFT JOIN (SELECT machine, program, any_value(message) FILTER (kind = 'program.opened') AS name,"
    " min(time) FILTER (kind = 'program.started') AS began FROM events WHERE program IS NOT NULL"
    " GROUP BY ALL) USING (machine, program)"
)
# of those what is no move by hand
_PROGRAMS = f"{_RUNS} WHERE coalesce(name, '') NOT IN ({', '.join(map(quoted, BY_HAND))})" + "".join(
    f" AND NOT starts_with(coalesce(name, ''), {quoted(each)})" for each in MOVES_BY_HAND
)
_ENDS = (
    "count(*) FILTER (state = 'finished') AS finished, count(*) FILTER (state <> 'finished') AS broken_off"
)
# the end of an interrupted run is said at the next start of its server, whenever that is
_TOOK_S = "CASE WHEN state <> 'interrupted' THEN epoch(time - began) END"
_RUNNING = (
    "round(100.0 * avg(CASE WHEN program_state = 'running' THEN 1 ELSE 0 END), 1) AS running_percent,"
    " count(*) AS states FROM states WHERE {span} GROUP BY ALL ORDER BY machine"
)
QUESTIONS = {
    # beside a fault the black box that was written for it
    "faults": "SELECT time, machine, coalesce(code, kind) AS code, axis, line, program,"
    " coalesce(nullif(message, ''), reason) AS message,"
    " (SELECT min_by(box.message, box.time) FROM events box WHERE box.kind = 'recording'"
    " AND box.machine = events.machine AND box.message LIKE 'blackbox-%'"
    " AND box.time BETWEEN events.time AND events.time + INTERVAL 2 MINUTE) AS recording"
    " FROM events WHERE kind IN ('fault', 'estop') AND {span} ORDER BY time DESC",
    "fault counts": "SELECT machine, coalesce(code, kind) AS code, count(*) AS times, max(time) AS latest"
    " FROM events WHERE kind IN ('fault', 'estop') AND {span} GROUP BY ALL ORDER BY times DESC",
    "programs": f"SELECT time, machine, program, name, state, round({_TOOK_S}, 1) AS took_s,"
    f" client, reason FROM {_RUNS} ORDER BY time DESC",
    "runs by program": f"SELECT machine, name, {_ENDS},"
    f" round(avg({_TOOK_S}), 1) AS mean_s, max(time) AS latest FROM {_PROGRAMS}"
    " GROUP BY machine, name ORDER BY finished DESC, name",
    "runs by day": f"SELECT machine, CAST(time AS DATE) AS day, {_ENDS} FROM {_PROGRAMS}"
    " GROUP BY ALL ORDER BY machine, day",
    "recordings": "SELECT time, machine, message AS recording FROM events"
    " WHERE kind = 'recording' AND {span} ORDER BY time DESC",
    "slow lines": "SELECT machine, program, line, end_s - start_s AS taken_s, requested_s, stretched_by,"
    " bound_by FROM lines WHERE stretched_by > 1.05 AND {span} ORDER BY taken_s - requested_s DESC",
    "running time": f"SELECT machine, CAST(time AS DATE) AS day, {_RUNNING}, day",
    "running time by hour": f"SELECT machine, hour(time) AS hour, {_RUNNING}, hour",
    "who": "SELECT time, machine, client, reason AS did, program, message FROM events"
    " WHERE kind = 'command' AND {span} ORDER BY time DESC",
}


def history(
    question: Annotated[
        str,
        typer.Argument(
            metavar="QUESTION",
            help='SQL over the tables events, lines and states, or such as "faults last week": '
            + ", ".join(QUESTIONS)
            + "; with today, last week, last month.",
        ),
    ],
    folder: Annotated[
        str,
        typer.Option(
            "--folder",
            "-f",
            metavar="DIR",
            envvar="MC_HISTORY",
            help="Of mcserver history, or its store, such as s3://bucket/history.",
        ),
    ] = "history",
    day: Annotated[
        str | None,
        typer.Option("--day", metavar="DAY[..DAY]", help="Look at files of these days alone (UTC)."),
    ] = None,
    json: JsonOption = False,
) -> None:
    """Ask the history of a fleet that mcserver history has written."""

    async def work() -> tuple[list[str], list[tuple[Any, ...]]]:
        return ask(question, folder, days_of(question, day, datetime.now(UTC).date()))

    names, rows = carry_out(work, json)
    if json:
        shown = [dict(zip(names, row, strict=True)) for row in rows]
        write_json({"ok": True, "rows": json_text.loads(json_text.dumps(shown, default=str))})
        return
    table = plain_table(*names, overflow="fold")
    for row in rows:
        table.add_row(*(Text("" if value is None else _plain(value)) for value in row))
    results().print(table)
    more = f", the first {MOST_ROWS}" if len(rows) == MOST_ROWS else ""
    say(f"{len(rows)} row{'' if len(rows) == 1 else 's'}{more}")


def _plain(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def sql_of(question: str) -> str:
    """Return the SQL of a ready question, or the question itself, which is SQL then."""
    words = " ".join(question.lower().split())
    for span, condition in SPANS.items():
        name = words.removesuffix(span).strip() if span else words
        if name in QUESTIONS and (not span or words.endswith(span)):
            return QUESTIONS[name].format(span=condition)
    return question


def days_of(question: str, chosen: str | None, today: date) -> list[date] | None:
    """Days whose files are looked at; None: all.

    Args:
        chosen: ``2026-05-05`` or ``2026-05-01..2026-05-07``; None: those of a ready question.

    Raises:
        RequestRefused: MC511 they are none, or more than a thousand.
    """
    words = " ".join(question.lower().split())
    last = next((count for span, count in SPAN_DAYS.items() if words.endswith(span)), None)
    if chosen is None:
        return None if last is None or sql_of(question) == question else _days(today, last)
    first, _, end = chosen.partition("..")
    with contextlib.suppress(ValueError):
        until = date.fromisoformat(end or first)
        count = (until - date.fromisoformat(first)).days
        if 0 <= count < MOST_DAYS:
            return _days(until, count)
    raise RequestRefused("MC511", f"{chosen[:40]!r} is no day", "2026-05-05, or 2026-05-01..2026-05-07")


def _days(until: date, before: int) -> list[date]:
    return [until - timedelta(number) for number in range(before + 1)]


def ask(
    question: str,
    folder: str | Path,
    days: list[date] | None = None,
    *,
    machine: str | None = None,
    threads: int | None = None,
) -> tuple[list[str], list[tuple[Any, ...]]]:
    """Names of the columns, and the first rows of the answer.

    Args:
        days: whose files are looked at; None: all.
        machine: the only one that is asked about. threads: the most that DuckDB may use.

    Raises:
        RequestRefused: MC511 there is no history, or it cannot be read, DuckDB is missing, or the question
            cannot be understood.
    """
    if importlib.util.find_spec("duckdb") is None:
        raise RequestRefused("MC511", "mcctl history needs duckdb", "pip install 'mcclient[record]'")
    import duckdb

    with duckdb.connect() as connection:
        # times are UTC
        connection.execute("SET TimeZone = 'UTC'")
        if threads is not None:
            connection.execute(f"SET threads = {threads:d}")
        if "://" in str(folder):
            _reach_store(connection, str(folder))
        try:
            there = _declare_views(connection, str(folder), days, machine)
        except duckdb.Error as error:
            raise RequestRefused(
                "MC511",
                f"{folder} cannot be read: {_why(error)}",
                "of a store, keys and endpoint stand in the environment, such as AWS_ACCESS_KEY_ID",
            ) from error
        try:
            cursor = connection.execute(sql_of(question))
            # there is none of a text without a statement
            names = [column[0] for column in getattr(cursor, "description", None) or []]
            if not names:
                raise RequestRefused(
                    "MC511", "this is no question", f"one of: {', '.join(QUESTIONS)}; or SQL"
                )
            return names, cursor.fetchmany(MOST_ROWS)
        except duckdb.Error as error:
            raise RequestRefused(
                "MC511",
                _why(error),
                "SQL over " + ", ".join(there) + "; or one of: " + ", ".join(QUESTIONS),
            ) from error


def _declare_views(connection: Any, folder: str, days: list[date] | None, machine: str | None) -> list[str]:
    """Make a view of each table that has files, and return their names.

    Raises:
        RequestRefused: MC511 there is no history.
    """
    # of many days a listing of all files takes longer than the answer
    wanted = ["*"] if days is None else [each.isoformat() for each in days]
    found = {table: [f"{folder}/{table}/day={day}/*.parquet" for day in wanted] for table in TABLES}
    paths = {table: [each for each in found[table] if _has_files(connection, each)] for table in TABLES}
    there = [table for table in TABLES if paths[table]]
    if not there:
        raise RequestRefused(
            "MC511", f"{folder} has no history", f"mcserver history {folder} writes it; --folder names it"
        )
    for table in there:
        files = ", ".join(map(quoted, paths[table]))
        rows = f"SELECT * FROM read_parquet([{files}], hive_partitioning = true)"
        if machine is not None:
            rows += f" WHERE machine = {quoted(machine)}"
        if table in KEYS:
            rows += f" QUALIFY row_number() OVER (PARTITION BY day, {KEYS[table]}) = 1"
        connection.execute(f"CREATE VIEW {table} AS {rows}")
    return there


def _why(error: Exception) -> str:
    """Return the line of an error that says what it is; of a store's package DuckDB has a whole traceback."""
    lines = str(error).strip().partition("\n\nLINE ")[0].splitlines()
    return lines[-1 if lines[0].startswith("Traceback") else 0]


def _reach_store(connection: Any, address: str) -> None:
    """Let DuckDB read an object store by fsspec, which needs no extension of DuckDB.

    Raises:
        RequestRefused: MC511 the store's package is missing, or the address cannot be meant.
    """
    try:
        import fsspec

        connection.register_filesystem(fsspec.url_to_fs(address)[0])
    except (ImportError, ValueError, OSError) as error:
        raise RequestRefused(
            "MC511", f"{address} cannot be read: {error}", "pip install 'mcclient[store]'"
        ) from error


def _has_files(connection: Any, files: str) -> bool:
    return connection.execute("SELECT 1 FROM glob(?) LIMIT 1", [files]).fetchone() is not None
