"""The mesh of a printer's bed that programs probe: what was met becomes what counts (D-144).

It counts until the server stops. Limits within which programs are planned hold with it: it is taken only
where `reserve` of its axis leaves as much as it needs.
"""

from __future__ import annotations

import msgspec
import numpy as np

from mcserver.executor.compensation import Compensator
from mcserver.executor.entries import Array
from mcserver.executor.error_tables import MeshErrors
from mcserver.executor.fault_codes import BarrierFault, FaultCode
from mcserver.machine.compensation_section import LEAST_FOR_BACKLASH
from mcserver.machine.coupled_errors import share_needed
from mcserver.machine.machine_file import Machine


class BedMesh:
    """The mesh, and the points that a program has met so far.

    Args:
        axis: number of the one whose mesh it is.
    """

    def __init__(self, machine: Machine, compensator: Compensator, axis: int) -> None:
        self._axes, self._compensator = machine.axes, compensator
        self._column = machine.column_of(axis)
        self._axis = machine.axes[self._column]
        (self._table,) = (
            each
            for each in compensator.tables
            if isinstance(each.errors, MeshErrors) and each.errors.column == self._column
        )
        # a reference is to be the same with a mesh and without
        self._table.needs = [*self._table.errors.sources, self._column]
        found = self._axis.compensation
        assert found is not None
        assert found.mesh is not None
        assert found.mesh.probe is not None
        self._beside_pitch, self._share = found.beside_pitch, found.share
        self._mesh, self._probe = found.mesh, found.mesh.probe
        self._met = np.full_like(found.mesh.heights, np.nan)

    @classmethod
    def of(cls, machine: Machine, compensator: Compensator | None) -> BedMesh | None:
        """Return the mesh that programs of a machine probe; None: there is none."""
        axis = machine.dialect.mesh_axis
        return None if axis is None or compensator is None else cls(machine, compensator, axis)

    def error_of(self, column: int) -> float:
        """Return by how much a column's positions are more than where it is, for the mesh [m]."""
        return self._table.error if column == self._column else 0.0

    def meet(self, place: Array, *, real: bool) -> None:
        """Take where the probe has met the bed, shape (K,) [m].

        Args:
            real: else the bed is taken to be as the mesh that counts has it.

        Raises:
            BarrierFault: the bed is further off than the machine file says.
        """
        point = []
        for source, places, offset in zip(
            self._table.errors.sources, self._mesh.places, self._probe.offset, strict=True
        ):
            point.append(int(np.abs(np.array(places) - place[source] - offset).argmin()))
        # the drive is beside the program by the mesh that counts
        beyond = self._probe.at - float(place[self._column]) if real else 0.0
        error = self._table.error + beyond
        if not abs(error) <= self._probe.greatest:
            values = (-error, self._probe.greatest)
            raise BarrierFault(FaultCode.BED_TOO_FAR, self._column, values)
        self._met[tuple(point)] = error

    def take(self) -> None:
        """Let what was met count from now on.

        Raises:
            BarrierFault: it is too steep; the mesh of before goes on.
        """
        mesh = msgspec.structs.replace(self._mesh, errors=self._met.T.tolist())
        needed = share_needed(self._axis, self._axes, mesh)
        most = self._beside_pitch - LEAST_FOR_BACKLASH
        if not needed <= most:
            raise BarrierFault(FaultCode.BED_TOO_STEEP, self._column, (needed, most))
        self._table.errors = MeshErrors(self._column, self._table.errors.sources, mesh)
        self._share = self._beside_pitch - needed
        self.switch(on=True)

    def switch(self, *, on: bool) -> None:
        """Let the mesh count, or not: its axis goes there within what is reserved of its limits."""
        self._table.on = on
        self._compensator.change(self._table, self._axis, self._share)
