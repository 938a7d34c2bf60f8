"""Where a program has sent its axes and tools: commanded ends, path starts, poses (D-14, D-25, D-50)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from mckinematics.pose import Pose


class Commanded:
    """Commanded ends of the axes [m or rad] and what is not known without the encoder.

    Attributes:
        positions: commanded ends, the bases of increments.
        starts: where a path starts if not at the commanded end: axes that were stopped on their way (D-25).
        unsettled: axes whose start only the executor knows; True: their base too (D-14).
        poses: last commanded pose of each tool. stale: tools one of whose joints moved without them.
        assumed: axes whose position is a guess after a fault; empty outside of checks.
    """

    __slots__ = ("assumed", "poses", "positions", "stale", "starts", "unsettled")

    def __init__(self, positions: Mapping[int, float]) -> None:
        self.positions = dict(positions)
        self.starts: dict[int, float] = {}
        self.unsettled: dict[int, bool] = {}
        self.poses: dict[int, Pose] = {}
        self.stale: set[int] = set()
        self.assumed: set[int] = set()

    def copy(self) -> Commanded:
        other = Commanded(self.positions)
        other.starts = dict(self.starts)
        other.unsettled = dict(self.unsettled)
        other.poses = dict(self.poses)
        other.stale = set(self.stale)
        other.assumed = set(self.assumed)
        return other

    def settled(self, axes: Sequence[int]) -> bool:
        """Whether these axes start at their commanded ends, and no tool has a pose to keep."""
        if self.poses:
            return False
        if not (self.starts or self.unsettled or self.assumed):
            return True
        return not any(axis in self.starts or axis in self.unsettled or axis in self.assumed for axis in axes)

    def start(self, axis: int) -> float:
        """Where a path of the axis starts."""
        return self.starts.get(axis, self.positions[axis])

    def path_starts(self) -> dict[int, float]:
        """Starts of all axes."""
        return {**self.positions, **self.starts}

    def end_at(self, axis: int, end: float) -> None:
        """A motion that is waited for, or that the next one continues, ends there."""
        self.positions[axis] = end
        self.starts.pop(axis, None)
        self.unsettled.pop(axis, None)
        self.assumed.discard(axis)

    def send_to(self, axis: int, target: float) -> None:
        """G1020: the commanded end is the target, but a later path may start before it is reached."""
        self.end_at(axis, target)
        self.unsettled[axis] = False

    def lose(self, axes: Iterable[int]) -> None:
        """After axis, speed and torque commands the encoder's reading counts."""
        for axis in axes:
            self.starts.pop(axis, None)
            self.unsettled[axis] = True

    def assume(self, axis: int) -> None:
        """After a fault: the axis may be anywhere."""
        self.assumed.add(axis)
        self.starts.pop(axis, None)
        self.unsettled.pop(axis, None)
