"""Commanded state of axes and tools: ends, path starts, poses (D-14, D-25, D-50)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from mckinematics.pose import Pose


class CommandedState:
    """Commanded positions of the axes [m or rad], and which of them only an encoder knows.

    Attributes:
        positions: commanded ends, the base of increments.
        starts: of paths, for axes that were stopped before their commanded end (D-25).
        unsynced: axes whose path start has to be read from the encoder; True: the base of increments too
            (D-14).
        poses: last commanded pose of each tool.
        stale: tools of which a joint was moved directly since that pose.
        guessed: axes whose position is a guess after a fault; only in checks.
        plane_lost: a tilted plane was refused (D-111), so that moves end where nobody knows; only in checks.
    """

    __slots__ = ("guessed", "plane_lost", "poses", "positions", "stale", "starts", "unsynced")

    def __init__(self, positions: Mapping[int, float]) -> None:
        self.positions = dict(positions)
        self.starts: dict[int, float] = {}
        self.unsynced: dict[int, bool] = {}
        self.poses: dict[int, Pose] = {}
        self.stale: set[int] = set()
        self.guessed: set[int] = set()
        self.plane_lost = False

    def copy(self) -> CommandedState:
        """Return an independent copy."""
        other = CommandedState(self.positions)
        other.starts = dict(self.starts)
        other.unsynced = dict(self.unsynced)
        other.poses = dict(self.poses)
        other.stale = set(self.stale)
        other.guessed = set(self.guessed)
        other.plane_lost = self.plane_lost
        return other

    def synced(self, axes: Sequence[int]) -> bool:
        """Return whether these axes start at their commanded ends and no tool has a pose to keep."""
        if self.poses:
            return False
        if not (self.starts or self.unsynced or self.guessed):
            return True
        return not any(axis in self.starts or axis in self.unsynced or axis in self.guessed for axis in axes)

    def start(self, axis: int) -> float:
        """Return the path start of an axis [m or rad]."""
        return self.starts.get(axis, self.positions[axis])

    def path_starts(self) -> dict[int, float]:
        """Return the path starts of all axes [m or rad]."""
        return {**self.positions, **self.starts}

    def end_at(self, axis: int, end: float) -> None:
        """Set the commanded end of a motion that is waited for, or that the next one continues."""
        self.positions[axis] = end
        self.starts.pop(axis, None)
        self.unsynced.pop(axis, None)
        self.guessed.discard(axis)

    def send_to(self, axis: int, target: float) -> None:
        """Set the target of G1020, before which a later path may start (D-25)."""
        self.end_at(axis, target)
        self.unsynced[axis] = False

    def invalidate(self, axes: Iterable[int]) -> None:
        """Require the encoder's reading, after axis, speed and torque commands (D-14)."""
        for axis in axes:
            self.starts.pop(axis, None)
            self.unsynced[axis] = True

    def mark_guessed(self, axis: int) -> None:
        """Mark an axis's position as a guess, after a fault."""
        self.guessed.add(axis)
        self.starts.pop(axis, None)
        self.unsynced.pop(axis, None)
