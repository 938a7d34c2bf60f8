"""Work coordinate systems, the tool table, the fitted tool and parameters, kept across programs and restarts.

See D-62, D-65 and D-81.
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
# cutting time between two writes of the file: the most that a crash can lose [s]
SAVED_EVERY_S = 20.0


class RowNote(msgspec.Struct, frozen=True, omit_defaults=True):
    """Data of a row besides its numbers.

    Attributes:
        name: for people. life_s: cutting time that a tool may have [s]; 0: not limited. used_s: that it has
            had.
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
    """A tool as set by G10 L1, and its values in the machine file then."""

    now: Cutter
    file: Cutter | None


class _Tables(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Content of the file beside that of the offsets."""

    cutters: dict[int, _SetCutter] = {}
    changes: list[TableChange] = []
    notes: dict[str, RowNote] = {}
    tool: int = 0
    parameters: dict[int, float] = {}


def offsets_file(journal: Path) -> Path:
    """Return the path of the offsets file beside a journal."""
    return journal.with_name(f"{journal.name}.offsets.json")


class WorkOffsets:
    """Work systems and tools as the last program left them.

    Args:
        path: of the file of systems, JSON: system → axis → m or rad, and a checksum. Tools and changes are in
            a file beside it.
        cutters: tool table of the machine file. A tool that was set otherwise overrides it until its values
            in the machine file change.
        write: as in `KeptFiles`.

    Attributes:
        systems: origins by number of the system, 1 for G54.
        notes: by row, of rows that have any. parameters: that stay, by number.
        tool: in the spindle of a machine with shapers by tool; 0: none, or unknown.
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
        self.parameters: dict[int, float] = kept.parameters
        # cutting time since the file was last written [s]
        self._unsaved_s = 0.0
        self._set_cutters = {
            number: each.now for number, each in kept.cutters.items() if each.file == cutters.get(number)
        }

    @property
    def failure(self) -> str:
        """Why they could not be stored; empty: they are, or storing is scheduled."""
        return self._files.failure

    @property
    def cutters(self) -> dict[int, Cutter]:
        """The tool table in force, by number."""
        return {**self._file_cutters, **self._set_cutters}

    def is_changed(self, tool: int) -> bool:
        """Return whether a tool's values were set, and are not the machine file's."""
        return tool in self._set_cutters

    def frame(self) -> Frame | None:
        """Return the initial frame of a program; None if nothing was ever set."""
        worn = frozenset(number for number in self.cutters if self.notes.get(f"T{number}", NO_NOTE).is_worn)
        if not (self.systems or self._set_cutters or self.notes or self.parameters):
            return None
        return Frame(systems=self.systems, cutters=self._set_cutters, worn=worn, parameters=self.parameters)

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
        """Store the changes of a program; if the file cannot be written they are only in memory.

        Args:
            frame: of the program now. before: its last one: the program has not changed what is equal in
                both, and another program may have; None: all of ``frame`` is new.
            wall: Unix time [s]. client, program, name: who changes them.
        """
        systems, cutters, parameters = dict(frame.systems), dict(frame.cutters), dict(frame.parameters)
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
            parameters = _merged(self.parameters, before.parameters, parameters)
        if (systems, cutters, parameters) == (self.systems, self._set_cutters, self.parameters):
            return
        rows = self._rows()
        moved = systems != self.systems
        self.systems, self._set_cutters, self.parameters = systems, cutters, parameters
        after = self._rows()
        for row in [row for row in {**rows, **after} if rows.get(row) != after.get(row)]:
            self._note(TableChange(wall, client, program, name, row, rows.get(row, {}), after.get(row, {})))
        files = self._tables_file()
        if moved:
            files[self._path] = with_checksum(msgspec.json.encode(self.systems))
        # systems first, so that no change is listed that is not stored
        self._files.put(files)

    def fit(self, tool: int) -> None:
        """Store the tool in the spindle."""
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
        """Name a row, or set a tool's life and use; None leaves a value as it is.

        Args:
            life_s: 0 removes the limit. client, by: who, and for whom.

        Returns:
            The change; None: nothing has changed.

        Raises:
            ServiceError: MC601 no such row, or the values are only for tools.
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
        """Add cutting time to a tool; return True if that uses up its life.

        Tools that are not in the table are not counted.
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
        """Write uses counted since the file was last written."""
        if self._unsaved_s > 0.0:
            self._files.put(self._tables_file())

    def worn_text(self, tool: int | None) -> str:
        """Return that a tool's life is used up, as text; empty: it is not, or is not limited."""
        note = self.notes.get(f"T{tool}", NO_NOTE)
        if tool not in self.cutters or not note.is_worn:
            return ""
        return f"tool {tool} has cut {note.used_s / MINUTE:.4g} of its {note.life_s / MINUTE:.4g} min"

    def refuse_worn(self, tool: int | None) -> None:
        """Refuse to continue with a tool whose life is used up.

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
        tables = _Tables(set_cutters, self.changes, self.notes, self.tool, self.parameters)
        return {self._tables_path: with_checksum(msgspec.json.encode(tables))}

    def _merged_cutter(self, number: int, then: Cutter | None, now: Cutter) -> Cutter:
        """Return a stored tool with a program's changes."""
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


def _merged(
    kept: Mapping[int, float], then: Mapping[int, float], now: Mapping[int, float]
) -> dict[int, float]:
    """Return stored numbers with one program's changes."""
    found = {**kept, **{number: at for number, at in now.items() if then.get(number) != at}}
    return {number: at for number, at in found.items() if number in now or number not in then}


def _read(path: Path, kind: Any, missing: Any) -> Any:
    """Return the content of a file.

    Raises:
        ServiceError: MC529 it exists and cannot be read.
    """
    try:
        return msgspec.json.decode(without_checksum(path.read_bytes()), type=kind)
    except FileNotFoundError:
        return missing
    except (OSError, ValueError, RecursionError) as error:
        # with other offsets or lengths than the last ones, programs would move somewhere else
        raise ServiceError(
            "MC529",
            f"the work offsets in {path} cannot be read: {error}",
            "restore the file, or move it away and set offsets (mcctl zero) and tools (G10 L1) again",
        ) from error
