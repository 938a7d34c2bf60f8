"""Read the journal: earlier programs, and their lines for a resumption."""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Iterator
from pathlib import Path

import msgspec

from mcserver.errors import Refused, ServiceError
from mcserver.planning.start_state import StartState
from mcserver.service.journal import KnownText
from mcserver.service.reports import Fault, ProgramStatus

_COLUMNS = (
    "program, client, name, axes, start_line, resume_of, state, started, done, fault, opened_at, ended_at,"
    " accepted"
)


@contextlib.contextmanager
def _reading(path: Path) -> Iterator[sqlite3.Connection]:
    """Open a journal for reading.

    Raises:
        ServiceError: MC520 it cannot be read.
    """
    # a separate connection: in WAL mode readers do not block the writer
    try:
        with contextlib.closing(
            sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)
        ) as connection:
            yield connection
    except sqlite3.Error as error:
        raise ServiceError(
            "MC520",
            f"the journal {path} cannot be read: {error}",
            "look at the disk; the next start of the server checks and repairs the journal",
        ) from error


def read_programs(path: Path, *, limit: int, program: str | None = None) -> list[ProgramStatus]:
    """Return programs in the journal, newest first, including those of this instance.

    A program without an end counts as ``interrupted``; the caller knows the state of its own running ones.
    """
    where, values = ("WHERE program=?", (program, limit)) if program else ("", (limit,))
    return _read_statuses(path, f"{where} ORDER BY id DESC LIMIT ?", values)


def read_unended(path: Path) -> list[ProgramStatus]:
    """Return programs in the journal without an end, oldest first: before a start, the interrupted ones."""
    return _read_statuses(path, "WHERE ended_at IS NULL ORDER BY id", ())


def _read_statuses(path: Path, which: str, values: tuple[object, ...]) -> list[ProgramStatus]:
    with _reading(path) as connection:
        rows = connection.execute(f"SELECT {_COLUMNS} FROM programs {which}", values).fetchall()
    found = []
    for (
        name,
        client,
        title,
        axes,
        start,
        resume_of,
        state,
        started,
        done,
        fault,
        opened,
        ended,
        accepted,
    ) in rows:
        found.append(
            ProgramStatus(
                program=name,
                state=state or "interrupted",
                client=client,
                name=title,
                axes=[int(axis) for axis in axes.split(",") if axis],
                start_line=start,
                line=started,
                accepted=accepted,
                done=done,
                credit=0,
                closed=True,
                override=100.0,
                progress=1.0 if state == "finished" else _share(done - start + 1, accepted - start + 1),
                fault=None if fault is None else msgspec.msgpack.decode(fault, type=Fault),
                resume_of=resume_of,
                opened_at=opened,
                ended_at=ended,
            )
        )
    return found


def _share(done: int, lines: int) -> float:
    return min(1.0, max(0.0, done / lines)) if lines > 0 else 0.0


class RecordedProgram(msgspec.Struct, frozen=True):
    """A program as needed to continue it.

    Attributes:
        text: what is known of its lines. sha256: of the whole text, if given.
        origin: state of the machine when it began, or for a program that never began but has operator's
            switches, when it was opened; None: it never began.
    """

    status: ProgramStatus
    text: KnownText
    sha256: str | None
    origin: StartState | None

    @property
    def whole(self) -> bool:
        """Whether its client had sent all of its lines."""
        return self.text is KnownText.WHOLE


def read_recorded(path: Path, program: str, *, last: bool = True) -> RecordedProgram:
    """Read a program, or with ``last`` the program that continued it last.

    Raises:
        ServiceError: MC503 no such program.
    """
    check_known(path, program)
    seen = {program}
    with _reading(path) as connection:
        while last:
            # a continuation whose lines never reached the journal has not begun
            row = connection.execute(
                "SELECT program FROM programs WHERE resume_of=? AND EXISTS(SELECT 1 FROM chunks WHERE"
                " chunks.program=programs.program AND last>=start_line) ORDER BY id DESC LIMIT 1",
                (program,),
            ).fetchone()
            if row is None or row[0] in seen:
                break
            program = row[0]
            seen.add(program)
        whole, sha256, origin = connection.execute(
            "SELECT whole, sha256, origin FROM programs WHERE program=?", (program,)
        ).fetchone()
    (status,) = read_programs(path, limit=1, program=program)
    return RecordedProgram(
        status,
        KnownText(whole),
        sha256,
        None if origin is None else msgspec.msgpack.decode(origin, type=StartState),
    )


def check_known(path: Path, program: str) -> None:
    """Refuse a program that is not in the journal.

    Raises:
        ServiceError: MC503.
    """
    with _reading(path) as connection:
        known = connection.execute("SELECT 1 FROM programs WHERE program=?", (program,)).fetchone()
    if known is None:
        raise Refused(
            "MC503",
            f"there is no program {program}",
            "list them with `programs`; those of a damaged journal were set aside (MC527)",
            program=program,
        )


def read_lines_before(path: Path, program: str, line: int) -> list[str]:
    """Return lines 1 … line - 1 of a program, to derive its modal state.

    Raises:
        ServiceError: MC503 no such program; MC514 the journal does not have all of these lines.
    """
    check_known(path, program)
    with _reading(path) as connection:
        rows = connection.execute(
            "SELECT first, last, lines FROM chunks WHERE program=? AND first<? ORDER BY first",
            (program, line),
        ).fetchall()
    lines: list[str] = []
    for first, last, blob in rows:
        if first != len(lines) + 1:
            break
        lines.extend(msgspec.msgpack.decode(blob, type=list[str])[: last - first + 1])
    if len(lines) < line - 1:
        held = f"{rows[0][0]} … {rows[-1][1]}" if rows else "none"
        raise Refused(
            "MC514",
            f"of lines 1 … {line - 1} of {program} the journal holds {held}",
            "send the lines before with `before`, or start from line 1",
            oldest_line=rows[0][0] if rows else 0,
        )
    return lines[: line - 1]


def read_lines_near(path: Path, program: str, first: int, last: int) -> tuple[int, list[str]]:
    """Return lines ``first`` … ``last`` of a program as far as the journal has them without a gap.

    Returns:
        Number of the first line, and the lines; empty if it has none of them.
    """
    with _reading(path) as connection:
        rows = connection.execute(
            "SELECT first, lines FROM chunks WHERE program=? AND first<=? AND last>=? ORDER BY first",
            (program, last, first),
        ).fetchall()
    start, lines = max(first, 1), list[str]()
    for at, blob in rows:
        if not lines:
            start = at
        elif at != start + len(lines):
            break
        lines.extend(msgspec.msgpack.decode(blob, type=list[str]))
    skipped = max(0, first - start)
    return start + skipped, lines[skipped : max(0, last - start + 1)]
