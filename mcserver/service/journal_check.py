"""Find what in a journal's file is intact; SQLite itself ignores much damage silently.

Every row has a checksum over all of its columns; a program has count and sum of its rows in ``chunks``, and
each table those of its rows in ``sums``, so that lost and old rows are found as well as damaged ones. Each
transaction is counted in the database and beside it (`mcserver.service.commit_record`), so that a lost
write-ahead log, or the loss of its end, is found.
"""

from __future__ import annotations

import contextlib
import sqlite3
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

from mcserver.errors import ServiceError
from mcserver.service.commit_record import CommitCount
from mcserver.service.journal_file import COMMITS, COUNTED, NAMES, SCHEMA_VERSION, row_checksum, schema

Row = Mapping[str, object]

_PROGRAM_INDEXES = (
    "SELECT program FROM programs INDEXED BY sqlite_autoindex_programs_1",
    "SELECT DISTINCT program FROM chunks INDEXED BY chunks_by_program",
)
# Oldest version that is read; it had a table of line times that was never read.
_OLDEST = 3
_NAMES_3: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {**NAMES, "programs": (*NAMES["programs"], "report_rows", "report_sum")}
)


class Sum(NamedTuple):
    """Count of rows, and the sum of their checksums."""

    rows: int = 0
    total: int = 0

    def with_row(self, checksum: int) -> Sum:
        """Return the sum including one more row."""
        return Sum(self.rows + 1, self.total + checksum)


class JournalRow(NamedTuple):
    """A row: its id, its values, and whether it is intact."""

    id: int
    row: Row
    sound: bool


class JournalContent:
    """Reads as much as possible of a journal that nobody writes.

    Args:
        connection: to the database, read-only. version: of its schema.

    Attributes:
        broken: tables that cannot be read completely.
    """

    def __init__(self, connection: sqlite3.Connection, version: int) -> None:
        self._connection = connection
        # text that is not UTF-8 has to fail at its checksum, not here
        connection.text_factory = lambda raw: str(raw, "utf-8", "surrogateescape")
        self.version = version
        self.names = NAMES if version == SCHEMA_VERSION else _NAMES_3
        self.broken: set[str] = set()

    def rows(self, table: str) -> Iterator[JournalRow]:
        """Yield each row that can be read, in no particular order."""
        names = self.names[table]
        for number, written, *values in self._scan(table, f"rowid, crc, {', '.join(names)}"):
            row = dict(zip(names, values, strict=True))
            yield JournalRow(int(str(number)), row, written == _checksum(values))

    def programs_of_indexes(self) -> set[str]:
        """Return the ids of programs in any index."""
        found: set[str] = set()
        for statement in _PROGRAM_INDEXES:
            for order in ("", " ORDER BY program DESC"):
                with contextlib.suppress(sqlite3.Error):
                    for (program,) in self._connection.execute(statement + order):
                        found.add(str(program))
        return found

    def structure_damage(self) -> str:
        """Describe damage to the structure of the database; empty without any."""
        try:
            ((verdict,),) = self._connection.execute("PRAGMA integrity_check(1)").fetchall()
        except (sqlite3.Error, ValueError) as error:
            return str(error)
        return "" if verdict == "ok" else str(verdict).splitlines()[-1]

    def _scan(self, table: str, columns: str) -> Iterator[Sequence[object]]:
        """Yield rows from the first on and, after one that cannot be read, from the last one backwards."""
        last = -1
        try:
            for row in self._connection.execute(f"SELECT {columns} FROM {table} ORDER BY rowid"):
                if row[0] <= last:
                    raise sqlite3.DatabaseError("rows out of order")
                last = row[0]
                yield row
            return
        except sqlite3.Error:
            self.broken.add(table)
        with contextlib.suppress(sqlite3.Error):
            before = None
            for row in self._connection.execute(
                f"SELECT {columns} FROM {table} WHERE rowid>? ORDER BY rowid DESC", (last,)
            ):
                if before is not None and row[0] >= before:
                    return
                before = row[0]
                yield row


class Findings(NamedTuple):
    """Result of a check.

    Attributes:
        damage: in words; empty without any.
        kept: programs that are intact.
        lost: ids of the others. commits: count of transactions that the journal ever had.
    """

    damage: list[str]
    kept: frozenset[str]
    lost: list[str]
    commits: int


@contextlib.contextmanager
def opened(path: Path) -> Iterator[JournalContent | None]:
    """Open a journal for reading, without changes; None if it is empty.

    Raises:
        ServiceError: MC520 it is not a journal, or has not the schema of its version.
    """
    uri = f"{path.absolute().as_uri()}?mode=ro"
    try:
        with contextlib.closing(sqlite3.connect(uri, uri=True, isolation_level=None)) as connection:
            (version,) = connection.execute("PRAGMA user_version").fetchone()
            found = {row[0] for row in connection.execute("SELECT sql FROM sqlite_master")} - {None}
            if not version and not found:
                yield None
                return
            if not _OLDEST <= version <= SCHEMA_VERSION:
                raise refusal(path, f"it is of version {version}")
            if version == SCHEMA_VERSION and found != set(schema()):
                raise refusal(path, "")
            if version < SCHEMA_VERSION and not {"programs", "chunks"} <= _tables(connection):
                raise refusal(path, "it has none of a journal's tables")
            yield JournalContent(connection, version)
    except (sqlite3.Error, TypeError, ValueError) as error:
        # a missing row or invalid text: results of a damaged first page
        raise refusal(path, str(error)) from error


def _tables(connection: sqlite3.Connection) -> set[str]:
    return {name for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type='table'")}


def refusal(path: Path, reason: str) -> ServiceError:
    """Return the refusal of a file that is not a journal."""
    said = reason or "its schema is damaged"
    return ServiceError(
        "MC520",
        f"{path} is no journal that can be read: {said}",
        "put a backup in its place, move it and the files beside it away, or give another with --journal",
    )


UNRECORDED = "the record of its commits (-commits) is missing or damaged: what was written last may be lost"


def examine(content: JournalContent, record: CommitCount | None) -> Findings:
    """Check everything in a journal.

    Args:
        record: of its commits; None without one.

    Raises:
        ServiceError: MC520 programs are lost whose ids are unknown.
    """
    structure = content.structure_damage()
    damage = [structure] if structure else []
    sums, sums_sound = _read_sums(content)
    counted: dict[str, Sum] = defaultdict(Sum)
    sums_by_program, wrong = _read_program_sums(content)
    programs: dict[str, Row] = {}
    for _, row, sound in content.rows("programs"):
        program = str(row["program"])
        if sound:
            programs[program] = row
            counted["programs"] = counted["programs"].with_row(_checksum(row.values()))
        else:
            wrong.add(program)
    for table in COUNTED:
        if table == "programs":
            continue
        for _, row, sound in content.rows(table):
            if sound:
                counted[table] = counted[table].with_row(_checksum(row.values()))
            else:
                wrong.add("")
    named = {
        each for each in {*programs, *sums_by_program, *wrong, *content.programs_of_indexes()} if _is_id(each)
    }
    uncounted = [table for table in COUNTED if counted[table] != sums.get(table)]
    if wrong or content.broken or uncounted or not sums_sound:
        damage.append("rows of it are damaged or missing")
    commits = sums.get(COMMITS, Sum()).rows
    missing = max(0, record.least - commits) if record is not None else 0
    if missing:
        damage.append(f"its last {missing} transactions are lost")
        named |= set(record.programs) if record is not None else set()
    # without the record the loss of a later transaction cannot be excluded
    unrecorded = record is None and commits > 0
    if unrecorded:
        damage.append(UNRECORDED)
    unsure = bool(missing) or unrecorded or "programs" in content.broken or "programs" in uncounted
    kept = {
        program
        for program, row in programs.items()
        if program not in wrong
        and _sum_of(row) == sums_by_program.get(program, Sum())
        # the row of a program that has not ended may be older than its last state
        and not (unsure and row["ended_at"] is None)
    }
    if sums_sound:
        expected = sums["programs"].rows
    else:
        # in an intact structure the table has as many rows as its index
        expected = 0 if not structure and "programs" not in content.broken else len(named) + 1
    if len(named) < expected:
        raise ServiceError(
            "MC520",
            "the journal is damaged, and which programs it has lost cannot be told",
            "put a backup in its place, move it and the files beside it away, or give another with --journal",
        )
    if set(programs) - kept and not damage:
        damage.append("rows of it are missing")
    known = max(commits, record.committed if record is not None else 0)
    return Findings(damage, frozenset(kept), sorted(named - kept), known)


def _read_sums(content: JournalContent) -> tuple[dict[str, Sum], bool]:
    found: dict[str, Sum] = {}
    whole = True
    for _, row, sound in content.rows("sums"):
        whole = whole and sound
        if sound:
            found[str(row["of"])] = Sum(int(str(row["rows"])), int(str(row["total"])))
    return found, whole and set(found) == {*COUNTED, COMMITS}


def _read_program_sums(content: JournalContent) -> tuple[dict[str, Sum], set[str]]:
    """Return the sums of each program's chunks, and the programs with damaged ones."""
    found: dict[str, Sum] = defaultdict(Sum)
    wrong: set[str] = set()
    for _, row, sound in content.rows("chunks"):
        program = str(row["program"])
        if sound:
            found[program] = found[program].with_row(_checksum(row.values()))
        else:
            wrong.add(program)
    return found, wrong


def _sum_of(program: Row) -> Sum:
    return Sum(int(str(program["chunk_rows"])), int(str(program["chunk_sum"])))


def _is_id(text: str) -> bool:
    return bool(text) and text != "None" and text.isprintable()


def _checksum(values: object) -> int:
    try:
        return row_checksum(*values)  # type: ignore[misc]
    except UnicodeEncodeError:
        # text that is not UTF-8 was never written
        return -1
