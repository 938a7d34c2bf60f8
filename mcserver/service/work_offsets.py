"""Work coordinate systems, the tool table and the tool in the spindle: kept over programs and restarts (D-62,
D-65).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import msgspec

from mcserver.errors import Refused, ServiceError
from mcserver.gcode.profiles.frame import Frame, Offsets
from mcserver.machine.dialect_section import Cutter
from mcserver.machine.work_systems import ANGLE, SYSTEM_NUMBERS
from mcserver.service.kept_file import KeptFiles, Write, with_checksum, without_checksum, write_at_once
from mcserver.units import MINUTE

CHANGES_KEPT = 100
NO_CUTTERS: Mapping[int, Cutter] = MappingProxyType({})
NO_CUTTER = Cutter(0.0)
# what is cut between two writes of the file: a crash loses no more of the count [s]
SAVED_EVERY_S = 20.0


class RowNote(msgspec.Struct, frozen=True, omit_defaults=True):
    """What is kept of a row beside its numbers.

    Attributes:
        name: for people. life_s: for how long a tool may cut [s]; 0: nobody has said. used_s: it has cut.
    """

    name: str = ""
    life_s: float = 0.0
    used_s: float = 0.0

    @property
    def is_worn(self) -> bool:
        """Whether the tool's life is used up."""
        return 0.0 < self.life_s <= self.used_s


NO_NOTE = RowNote()


class TableChange(msgspec.Struct, frozen=True):
    """Who changed a row of the tables; what one program does to one row in turn is one change.

    Attributes:
        wall: Unix time [s]. client: whose program it was. program: its id. name: of the program.
        row: ``G54`` to ``G59.3``, or ``T3``.
        before, after: by axis number, ``R`` of a turned system, or ``length`` and ``diameter`` [m, rad; in
            messages mm, deg]; empty: the row was not there. Or a tool's ``life`` and what it has ``used`` [s;
            in messages min].
        was_called, called: its name before and after, where that was changed.
    """

    wall: float
    client: str
    program: str
    name: str
    row: str
    before: dict[str, float]
    after: dict[str, float]
    was_called: str = ""
    called: str = ""


class _SetCutter(msgspec.Struct, frozen=True):
    """A tool as G10 L1 set it, and what the machine file said of it then."""

    now: Cutter
    file: Cutter | None


class _Tables(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The file beside that of the offsets."""

    cutters: dict[int, _SetCutter] = {}
    changes: list[TableChange] = []
    notes: dict[str, RowNote] = {}
    tool: int = 0


def offsets_file(journal: Path) -> Path:
    """Return the file beside a journal."""
    return journal.with_name(f"{journal.name}.offsets.json")


class WorkOffsets:
    """The systems and tools that the last program left behind.

    Args:
        path: of the file that keeps the systems, JSON: system → axis → m or rad, and a checksum. Tools and
            changes are kept beside it.
        cutters: the tool table of the machine file. A tool that was set otherwise counts until the machine
            file says something else of it than it did then.
        write: as of `KeptFiles`.

    Attributes:
        systems: origins by the number of the system, 1 for G54.
        notes: by row, of those that have any.
        tool: in the spindle of a machine whose shapers go by it; 0: none, or nobody has said.
        changes: the newest `CHANGES_KEPT`, oldest first.

    Raises:
        ServiceError: MC529 a file is there and cannot be read.
    """

    def __init__(
        self,
        path: Path,
        cutters: Mapping[int, Cutter] = NO_CUTTERS,
        write: Write = write_at_once,
    ) -> None:
        self._path = path
        self._files = KeptFiles("MC529", "work offsets", write)
        self._tables_path = path.with_name(f"{path.name}.tables.json")
        self._file_cutters = cutters
        self.systems: dict[int, Offsets] = dict(_read(path, dict[int, dict[int, float]], {}))
        kept = _read(self._tables_path, _Tables, _Tables())
        self.changes: list[TableChange] = kept.changes
        self.notes: dict[str, RowNote] = kept.notes
        self.tool = kept.tool
        # what tools have cut since the file was last written [s]
        self._unsaved_s = 0.0
        self._set_cutters = {
            number: each.now for number, each in kept.cutters.items() if each.file == cutters.get(number)
        }

    @property
    def failure(self) -> str:
        """Why they could not be kept; empty: they are, or are to be."""
        return self._files.failure

    @property
    def cutters(self) -> dict[int, Cutter]:
        """The tool table in force, by number."""
        return {**self._file_cutters, **self._set_cutters}

    def is_changed(self, tool: int) -> bool:
        """Return True if a tool counts as it was set, not as the machine file has it."""
        return tool in self._set_cutters

    def frame(self) -> Frame | None:
        """Return the frame that a program starts in; None where nothing was ever set."""
        worn = frozenset(number for number in self.cutters if self.notes.get(f"T{number}", NO_NOTE).is_worn)
        if not self.systems and not self._set_cutters and not self.notes:
            return None
        return Frame(systems=self.systems, cutters=self._set_cutters, worn=worn)

    def keep(
        self,
        frame: Frame,
        *,
        before: Frame | None = None,
        wall: float = 0.0,
        client: str = "",
        program: str = "",
        name: str = "",
    ) -> None:
        """Keep what a program has changed; a file that cannot be written leaves it in memory.

        Args:
            frame: as the program has it now. before: as it had it last: what is the same in both it has not
                changed, and another program may have; None: all of ``frame`` counts.
            wall: Unix time [s]. client, program, name: who changes them.
        """
        systems, cutters = dict(frame.systems), dict(frame.cutters)
        if before is not None:
            systems = {
                number: _merged(
                    self.systems.get(number, {}), before.systems.get(number, {}), systems.get(number, {})
                )
                for number in self.systems.keys() | systems.keys()
            }
            cutters = self._set_cutters | {
                number: self._merged_cutter(number, before.cutters.get(number), now)
                for number, now in cutters.items()
                if now != before.cutters.get(number)
            }
        if systems == self.systems and cutters == self._set_cutters:
            return
        rows = self._rows()
        moved = systems != self.systems
        self.systems, self._set_cutters = systems, cutters
        after = self._rows()
        for row in [row for row in {**rows, **after} if rows.get(row) != after.get(row)]:
            self._note(TableChange(wall, client, program, name, row, rows.get(row, {}), after.get(row, {})))
        files = self._tables_file()
        if moved:
            files[self._path] = with_checksum(msgspec.json.encode(self.systems))
        # systems first: who changed what is said of nothing that is not kept
        self._files.put(files)

    def fit(self, tool: int) -> None:
        """Keep which tool is in the spindle."""
        if tool != self.tool:
            self.tool = tool
            self._files.put(self._tables_file())

    def annotate(
        self,
        row: str,
        *,
        name: str | None = None,
        life_s: float | None = None,
        used_s: float | None = None,
        wall: float = 0.0,
        client: str = "",
        by: str = "",
    ) -> TableChange | None:
        """Name a row, or say how long a tool may cut and has cut; what is None stays.

        Args:
            life_s: 0 takes the limit away. client, by: who, and for whom it does so.

        Returns:
            What has changed; None: it was so before.

        Raises:
            ServiceError: MC601 there is no such row, or only tools have what is said.
        """
        is_tool = row in {f"T{number}" for number in self.cutters}
        if not is_tool and row not in SYSTEM_NUMBERS:
            raise ServiceError(
                "MC601",
                f"the tables have no row {row}",
                "rows are G54 to G59.3, and T with the number of a tool: one is put in by G10 L1 P3 Z75.2 R3",
            )
        if not is_tool and (life_s is not None or used_s is not None):
            raise ServiceError("MC601", f"{row} is no tool and has no life", "name a tool, such as T3")
        was = self.notes.get(row, NO_NOTE)
        now = RowNote(
            was.name if name is None else name.strip(),
            was.life_s if life_s is None else life_s,
            was.used_s if used_s is None else used_s,
        )
        if now == was:
            return None
        self.notes = {**self.notes, row: now}
        if now == NO_NOTE:
            del self.notes[row]
        then, today = {"life": was.life_s, "used": was.used_s}, {"life": now.life_s, "used": now.used_s}
        differing = [each for each in then if then[each] != today[each]]
        names = (was.name, now.name) if was.name != now.name else ("", "")
        change = TableChange(
            wall,
            client,
            "",
            by,
            row,
            {each: then[each] for each in differing},
            {each: today[each] for each in differing},
            *names,
        )
        self.changes = [*self.changes, change][-CHANGES_KEPT:]
        self._files.put(self._tables_file())
        return change

    def cut(self, tool: int, seconds: float) -> bool:
        """Count that a tool has cut; return True where its life is used up by that.

        What is not in the table is not counted.
        """
        if tool not in self.cutters:
            return False
        row = f"T{tool}"
        was = self.notes.get(row, NO_NOTE)
        now = self.notes[row] = msgspec.structs.replace(was, used_s=was.used_s + seconds)
        self._unsaved_s += seconds
        if self._unsaved_s >= SAVED_EVERY_S:
            self.save_use()
        return now.is_worn and not was.is_worn

    def save_use(self) -> None:
        """Keep what was counted since the file was last written."""
        if self._unsaved_s > 0.0:
            self._files.put(self._tables_file())

    def worn_text(self, tool: int | None) -> str:
        """Return that a tool's life is used up; empty: it is not, or nobody has said how long it is."""
        note = self.notes.get(f"T{tool}", NO_NOTE)
        if tool not in self.cutters or not note.is_worn:
            return ""
        return f"tool {tool} has cut {note.used_s / MINUTE:.4g} of its {note.life_s / MINUTE:.4g} min"

    def refuse_worn(self, tool: int | None) -> None:
        """Refuse to go on with a tool whose life is used up.

        Raises:
            Refused: MC602.
        """
        text = self.worn_text(tool)
        if text:
            raise Refused(
                "MC602",
                f"the tool that is asked for is used up: {text}",
                f"fit a new one and say so, or make its life longer: mcctl tables T{tool} --used 0",
            )

    def _tables_file(self) -> dict[Path, bytes]:
        set_cutters = {
            number: _SetCutter(each, self._file_cutters.get(number))
            for number, each in self._set_cutters.items()
        }
        self._unsaved_s = 0.0
        tables = _Tables(set_cutters, self.changes, self.notes, self.tool)
        return {self._tables_path: with_checksum(msgspec.json.encode(tables))}

    def _merged_cutter(self, number: int, then: Cutter | None, now: Cutter) -> Cutter:
        """Return a tool as it is kept, with what a program has changed of it."""
        then = then or self._file_cutters.get(number, NO_CUTTER)
        kept = self.cutters.get(number, NO_CUTTER)
        return Cutter(
            kept.length if now.length == then.length else now.length,
            kept.diameter if now.diameter == then.diameter else now.diameter,
        )

    def _rows(self) -> dict[str, dict[str, float]]:
        rows = {
            name: {
                "R" if axis == ANGLE else str(axis): at
                for axis, at in sorted(self.systems.get(number, {}).items())
            }
            for name, number in SYSTEM_NUMBERS.items()
            if number in self.systems
        }
        for number, each in sorted(self.cutters.items()):
            rows[f"T{number}"] = {"length": each.length, "diameter": each.diameter}
        return rows

    def _note(self, change: TableChange) -> None:
        last = self.changes[-1] if self.changes else None
        if last is not None and (last.program, last.row) == (change.program, change.row):
            self.changes.pop()
            change = msgspec.structs.replace(change, before=last.before)
        self.changes = [*self.changes, change][-CHANGES_KEPT:]


def _merged(kept: Offsets, then: Offsets, now: Offsets) -> Offsets:
    """Return what is kept with what one program has changed of it."""
    return {**kept, **{axis: at for axis, at in now.items() if then.get(axis) != at}}


def _read(path: Path, kind: Any, missing: Any) -> Any:
    """Return what a file holds.

    Raises:
        ServiceError: MC529 it is there and cannot be read.
    """
    try:
        return msgspec.json.decode(without_checksum(path.read_bytes()), type=kind)
    except FileNotFoundError:
        return missing
    except (OSError, ValueError, RecursionError) as error:
        # programs that start from other offsets or lengths than the last ones move somewhere else
        raise ServiceError(
            "MC529",
            f"the work offsets in {path} cannot be read: {error}",
            "restore the file, or move it away and set offsets (mcctl zero) and tools (G10 L1) again",
        ) from error
