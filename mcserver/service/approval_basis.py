"""Basis of an approval: all inputs of its simulation, as a digest, and the names of changed ones."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from importlib import metadata

from mcserver.executor.envelope_bounds import POSITION_TOLERANCES, TIP_TOLERANCE, Envelope, enforced
from mcserver.machine.machine_digest import canonical_bytes, machine_digest
from mcserver.machine.machine_file import Machine
from mcserver.planning.start_state import StartState, axis_word, changes_between
from mcserver.service.arming import Extent, RunRequest, ToolExtent
from mcserver.units import MM

# Speeds and times of two simulations of the same motion differ by less than this share.
SAME = 1e-3


class ApprovalBasis:
    """Basis of the approvals of one machine.

    Args:
        machine: as its file was read at this start.

    Attributes:
        machine: the machine. unchanging: digest of the machine file, version of the server.
    """

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self.unchanging = (machine_digest(machine), server_version())
        self._tolerance = {axis.index: POSITION_TOLERANCES * axis.in_position for axis in machine.axes}

    def digest(self, text: str, axes: tuple[int, ...], start: StartState) -> str:
        """Return the SHA-256 of text, axes, start state, machine file and server version, hexadecimal."""
        basis = (text, axes, start, *self.unchanging)
        return hashlib.sha256(canonical_bytes(basis)).hexdigest()

    def changes(self, run: RunRequest, now: StartState, references: Mapping[int, float]) -> list[str]:
        """Name what has changed since a run was simulated; axes may be within tolerance of their positions.

        Args:
            references: present ones of axes.
        """
        changed = changes_between(
            self.machine, run.start, now, axes=run.axes, inputs=run.inputs, tolerance=self._tolerance
        )
        return self._moved(run.references, references, run.axes) + changed

    def _moved(
        self, before: Mapping[int, float], now: Mapping[int, float], axes: tuple[int, ...]
    ) -> list[str]:
        """Name axes whose positions differ because of another reference."""
        return [
            f"{axis_word(self.machine, axis)} has another reference"
            for axis in axes
            if axis in now and not abs(now[axis] - before.get(axis, math.inf)) <= self._tolerance[axis]
        ]

    def beyond(self, approval: RunRequest, run: RunRequest) -> list[str]:
        """Name what of a run exceeds a standing approval; empty if it stays within."""
        within, asked = approval.envelope, run.envelope
        if within is None or asked is None:
            return ["it has no envelope"]
        found = self._moved(approval.references, run.references, approval.axes)
        for column, axis in enumerate(self.machine.axes):
            if axis.index not in run.axes:
                continue
            word, unit, aside = axis_word(self.machine, axis.index), axis.type, self._tolerance[axis.index]
            low, high, speed = (each[column] for each in (asked.low, asked.high, asked.speed))
            if axis.index not in approval.axes:
                found.append(f"it may move {word}")
                continue
            if (asked.turning & ~within.turning) >> column & 1:
                found.append(f"it turns {word} at a speed")
            for place in (low, high):
                if not within.low[column] - aside <= place <= within.high[column] + aside:
                    found.append(f"{word} goes to {place / unit.si_per_unit:.3f} {unit.unit}")
            if speed > (1.0 + SAME) * within.speed[column]:
                found.append(f"{word} moves at {speed / unit.si_per_unit:.1f} {unit.unit}/s")
        tips = {tip.tool: tip for tip in within.tips}
        for tip in asked.tips:
            seen = tips.get(tip.tool)
            inside = seen is not None and all(
                least - TIP_TOLERANCE <= low and high <= most + TIP_TOLERANCE
                for low, high, least, most in zip(tip.low, tip.high, seen.low, seen.high, strict=True)
            )
            if seen is None or not inside:
                found.append(f"the tip of tool {tip.tool} leaves its box")
            elif tip.speed > (1.0 + SAME) * seen.speed:
                found.append(f"the tip of tool {tip.tool} moves at {tip.speed / MM:.1f} mm/s")
        for channel, (low, high), (least, most) in zip(
            self.machine.outputs, run.outputs, approval.outputs, strict=True
        ):
            if low < least or high > most:
                found.append(f'it sets the output "{channel.name}"')
        if asked.seconds > (1.0 + SAME) * within.seconds:
            found.append(f"it lasts {asked.seconds:.1f} s")
        found += [f"it {effect}" for effect in run.effects if effect not in approval.effects]
        seen_codes = {each.code for each in approval.warnings}
        fresh = {each.code: each.line for each in reversed(run.warnings) if each.code not in seen_codes}
        found += [f"its simulation warns of {code}, line {line}" for code, line in fresh.items()]
        if run.unshown > approval.unshown:
            found.append(f"its simulation warns of {run.unshown} things more than are kept")
        return found

    def envelope(self, run: RunRequest, now: StartState) -> Envelope | None:
        """Return the envelope that the executor enforces on a run that begins now."""
        if run.envelope is None:
            return None
        axes = [axis.index for axis in self.machine.axes]
        drift = [abs(now.positions[axis] - run.start.positions[axis]) for axis in axes]
        return enforced(run.envelope, self.machine, run.override, drift)


def server_version() -> str:
    """Return the version of this server."""
    try:
        return metadata.version("mcserver")
    except metadata.PackageNotFoundError:
        # run from a source tree that is not installed
        return "0"


def extents_of(machine: Machine, envelope: Envelope, axes: tuple[int, ...]) -> tuple[Extent, ...]:
    """Return the extents of a run's axes for people, in mm and degrees."""
    found = []
    for axis in axes:
        column = machine.column_of(axis)
        kind = machine.axes[column].type
        low, high, speed = (
            each[column] / kind.si_per_unit for each in (envelope.low, envelope.high, envelope.speed)
        )
        found.append(Extent(axis, low, high, kind.unit, speed, bool(envelope.turning >> column & 1)))
    return tuple(found)


def tools_of(envelope: Envelope) -> tuple[ToolExtent, ...]:
    """Return the extents of a run's tools for people, in mm."""
    return tuple(
        ToolExtent(
            tip.tool, [each / MM for each in tip.low], [each / MM for each in tip.high], tip.speed / MM
        )
        for tip in envelope.tips
    )
