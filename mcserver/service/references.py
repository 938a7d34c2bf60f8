"""References of axes that outlast the server: of absolute encoders, and those set by hand."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import msgspec

from mcserver.executor.process_start import StoredReference
from mcserver.machine.axis import Axis
from mcserver.machine.machine_file import Machine
from mcserver.service.kept_file import KeptFiles, Write, with_checksum, without_checksum, write_at_once


def references_file(journal: Path) -> Path:
    """Return the path of the references file beside a journal."""
    return journal.with_name(f"{journal.name}.references.json")


class References:
    """References stored in a file: JSON, axis → offset and, for other than absolute encoders, the encoder's
    reading when the axis last was at rest.

    A reference set by hand is valid after a restart only if the encoder still has that reading: one that has
    lost power restarts its count. While the axis may move, the reading is not stored.

    Args:
        path: of the file. write: as in `KeptFiles`.

    Attributes:
        damage: why it could not be read; empty: it could.
    """

    def __init__(self, path: Path, machine: Machine, write: Write = write_at_once) -> None:
        self._path = path
        self._file = KeptFiles("MC459", "references", write)
        self._kept = {axis.index: axis for axis in machine.axes if _is_kept(axis)}
        self.damage = ""
        found: dict[int, StoredReference] = {}
        try:
            found = msgspec.json.decode(without_checksum(path.read_bytes()), type=dict[int, StoredReference])
        except FileNotFoundError:
            pass
        except (OSError, ValueError, RecursionError) as error:
            self.damage = f"the references in {path} cannot be read: {error}; their axes are not homed"
        self._stored = {axis: each for axis, each in found.items() if axis in self._kept}

    @property
    def failure(self) -> str:
        """Why it could not be written; empty: it could, or writing is scheduled."""
        return self._file.failure

    @property
    def holding(self) -> Mapping[int, StoredReference]:
        """References that an executor may use at its start, by axis number."""
        return {
            axis: StoredReference(each.offset) if self._absolute(axis) else each
            for axis, each in self._stored.items()
            if self._absolute(axis) or each.reading is not None
        }

    @property
    def axes(self) -> frozenset[int]:
        """Axes with a reference in the file."""
        return frozenset(self._stored)

    def keep(self, axis: int, offset: float, reading: float) -> None:
        """Store the reference of an axis at rest [m or rad]."""
        if axis in self._kept:
            self._stored[axis] = StoredReference(offset, None if self._absolute(axis) else reading)
            self._write()

    def forget(self, axis: int) -> None:
        """Remove the reference of an axis."""
        if self._stored.pop(axis, None) is not None:
            self._write()

    def may_move(self, axes: Iterable[int]) -> bool:
        """Remove the stored readings of axes; return whether the file has to be written before they move."""
        changed = False
        for axis in axes:
            stored = self._stored.get(axis)
            if stored is not None and stored.reading is not None:
                self._stored[axis] = StoredReference(stored.offset)
                changed = True
        if changed:
            self._write()
        return changed

    def stand(self, positions: Mapping[int, float]) -> None:
        """Store the axes' readings at these positions [m or rad], as the server stops."""
        for axis, stored in self._stored.items():
            if not self._absolute(axis) and axis in positions:
                self._stored[axis] = StoredReference(stored.offset, positions[axis] - stored.offset)
        if self._stored:
            self._write()

    def _absolute(self, axis: int) -> bool:
        homing = self._kept[axis].homing
        return homing is not None and homing.absolute

    def _write(self) -> None:
        self._file.put({self._path: with_checksum(msgspec.json.encode(self._stored))})


def _is_kept(axis: Axis) -> bool:
    return axis.homing is not None and (axis.homing.absolute or axis.homing.method == "manual")
