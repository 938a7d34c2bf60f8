"""Canonical motion, in SI: what a line of G-code means, and the seam between dialect and motion.

The interpreter of `mcserver.gcode` makes one of these values of each line that does something; the planner
turns them into setpoints. They are frozen and compare by value.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import ArcCurve, Array, Curve, LineCurve, TipColumns

# Comma groups whose times T differ by no more than this share are taken to have the same T.
SAME_TIME = 1e-9


class AxisOperation(enum.Enum):
    """G1000, G1001, G1002, G1010, G1011 (D-40), G1060, G1061 (D-130)."""

    RESET = "reset"
    OFF = "off"
    STOP = "stop"
    CAPTURE = "capture"
    RELEASE = "release"
    COUPLE = "couple"
    UNCOUPLE = "uncouple"

    @property
    def energized(self) -> bool | None:
        """Whether the operation leaves its axes energized and holding position; None: unchanged."""
        if self in (AxisOperation.COUPLE, AxisOperation.UNCOUPLE):
            return None
        return self is AxisOperation.CAPTURE


class FeedGroup(msgspec.Struct, frozen=True):
    """One comma group of G01-G03: concatenated commands that share one path fraction (D-31).

    Attributes:
        curves: in reading order; ``reference`` sets the time. No axis is in two of them.
        duration: G93: T = 60/F [s]; None under G94.
        speed: G94: path speed of the curve that sets the time [m/s or rad/s]; None under G93.
        requested: T that the program asks for [s]: 60/F, or length/F.
        reference: index in ``curves`` of the command whose length and speed set the time.
        carried: tools chosen before this line, the latest last; the payload of each moves with its joint.
    """

    curves: tuple[Curve, ...]
    requested: float
    duration: float | None = None
    speed: float | None = None
    reference: int = 0
    carried: tuple[int, ...] = ()

    @property
    def axes(self) -> tuple[int, ...]:
        return tuple(axis for curve in self.curves for axis in curve.axes)


class RapidGroup(msgspec.Struct, frozen=True):
    """G00 (``wait``) or G1020 (no wait): each axis moves independently to its target [m or rad].

    Attributes:
        carried: as in `FeedGroup`.
    """

    axes: tuple[int, ...]
    targets: tuple[float, ...]
    wait: bool
    carried: tuple[int, ...] = ()


class SurfaceSpeed(msgspec.Struct, frozen=True):
    """G96, constant surface speed: the spindle's speed follows from the tool's radius (D-120).

    Attributes:
        axis: its distance from ``zero`` [m] is the radius. speed: at the surface [m/s].
        greatest: speed of the spindle [rad/s].
    """

    axis: int
    zero: float
    speed: float
    greatest: float

    def at(self, place: float) -> float:
        """Return the spindle's speed with the axis at ``place`` [rad/s]."""
        radius = abs(place - self.zero)
        return self.greatest if self.speed >= self.greatest * radius else self.speed / radius


class SpeedGroup(msgspec.Struct, frozen=True):
    """G1030 and the spindle: velocities of the axes [m/s or rad/s], converted from motor RPM.

    Attributes:
        surface: constant surface speed that sets the one axis's velocity from then on; ``velocities`` has
            the first value. None: the velocities stay.
    """

    axes: tuple[int, ...]
    velocities: tuple[float, ...]
    surface: SurfaceSpeed | None = None


class TorqueGroup(msgspec.Struct, frozen=True):
    """G1040: torques [N·m]."""

    axes: tuple[int, ...]
    torques: tuple[float, ...]


class DwellGroup(msgspec.Struct, frozen=True):
    """G04."""

    seconds: float


Group = FeedGroup | RapidGroup | SpeedGroup | TorqueGroup | DwellGroup


class MotionLine(msgspec.Struct, frozen=True):
    """One line with motion, dwell or transmitted commands.

    Attributes:
        line: number of the line in the file or program, from 1.
        groups: the comma groups in reading order; they start together.
        exact_stop: G61, G09 or G00: the line ends when the encoders are in tolerance (D-34).
        tolerance: path tolerance for rounding its corners [m]; 0: exact path.
        feed_length: sum of the linear lengths of its G01-G03 commands [m].
    """

    line: int
    groups: tuple[Group, ...]
    exact_stop: bool = False
    tolerance: float = 0.0
    feed_length: float = 0.0


class OutputSetting(msgspec.Struct, frozen=True):
    """Set the machine's output of a column to a value in its unit.

    Attributes:
        scaled: multiply a laser's power by actual path speed / programmed path speed (D-77).
    """

    column: int
    value: float
    scaled: bool = False


class OutputLine(msgspec.Struct, frozen=True):
    """M62 to M65, M67, M68: set outputs.

    Attributes:
        with_motion: set in the cycle in which the next motion begins (D-70); else once the motion before has
            ended (D-71).
    """

    line: int
    settings: tuple[OutputSetting, ...]
    with_motion: bool


class SpeedOutputs(msgspec.Struct, frozen=True, eq=False):
    """Outputs that S sets as the motion of its line begins (D-70, D-77).

    Attributes:
        outputs: column of each, and whether it is `OutputSetting.scaled`.
        values: shape (n,), S of each line of a batch, NaN where it has none.
    """

    outputs: tuple[tuple[int, bool], ...]
    values: Array

    def settings(self, value: float) -> tuple[OutputSetting, ...]:
        """Return the settings of an S; none where ``value`` is NaN."""
        if math.isnan(value):
            return ()
        return tuple(OutputSetting(column, value, scaled) for column, scaled in self.outputs)


class PathBatch(msgspec.Struct, frozen=True, eq=False):
    """Consecutive lines of one G01, G02 or G03 each, as columns of numbers: n `MotionLine` without their
    objects. Lines may name different axes.

    Attributes:
        lines: shape (n,), numbers of the lines in the file or program, increasing.
        axes: K axis numbers, all that any line moves. points: shape (n+1, K), where the first line starts and
            where each line ends [m or rad].
        frames: the distinct sets of axes, each as in `Curve.axes`. frame: shape (n,), each line's index in
            ``frames``.
        centres: of arcs, as `ArcCurve.centre`, shape (n, 2) [m]; NaN for lines.
        sweeps: of arcs, as `ArcCurve.sweep`, shape (n,) [rad]; 0 for lines.
        lengths: shape (n,), as `Curve.length`. travels: shape (n,), the linear part of each [m].
        requested: shape (n,), T that the program asks for [s]: 60/F, or length/F.
        speeds: G94: path speeds, shape (n,) [m/s or rad/s]; None under G93, where T is ``requested``.
        tolerances, exact_stop: as in `MotionLine`, shape (n,), and the same for all lines.
        outputs: that S sets; None: no line has an S that sets any.
        tips: of lines that lead a tool's tip; ``travels`` are the tip's; None: no line leads one.
        carried: as in `FeedGroup`.
    """

    lines: NDArray[np.int64]
    axes: tuple[int, ...]
    points: Array
    frames: tuple[tuple[int, ...], ...]
    frame: NDArray[np.intp]
    centres: Array
    sweeps: Array
    lengths: Array
    travels: Array
    requested: Array
    speeds: Array | None
    tolerances: Array
    exact_stop: bool = False
    outputs: SpeedOutputs | None = None
    tips: TipColumns | None = None
    carried: tuple[int, ...] = ()

    def __len__(self) -> int:
        return len(self.lines)

    @property
    def line(self) -> int:
        """Number of the first line."""
        return int(self.lines[0])

    def part(self, first: int, behind: int) -> PathBatch:
        """Return lines ``first`` … ``behind`` - 1, counted from 0, over the axes that any of them moves."""
        at = slice(first, behind)
        frame = self.frame[at]
        if (frame == frame[0]).all():
            # a few lines between two rapids mostly share one frame: spare them the sort of np.unique
            used, frame = [int(frame[0])], np.zeros_like(frame)
        else:
            found, frame = np.unique(frame, return_inverse=True)
            used = found.tolist()
        frames = tuple([self.frames[each] for each in used])
        axes = tuple([axis for axis in self.axes if any(axis in each for each in frames)])
        return PathBatch(
            self.lines[at],
            axes,
            self.points[first : behind + 1, [self.axes.index(axis) for axis in axes]],
            frames,
            frame,
            self.centres[at],
            self.sweeps[at],
            self.lengths[at],
            self.travels[at],
            self.requested[at],
            None if self.speeds is None else self.speeds[at],
            self.tolerances[at],
            self.exact_stop,
            None if self.outputs is None else SpeedOutputs(self.outputs.outputs, self.outputs.values[at]),
            None if self.tips is None else self.tips.part(at),
            self.carried,
        )

    def first_beyond(self, axes: set[int]) -> tuple[int, tuple[int, ...]] | None:
        """Return number and axes of the first line that moves an axis outside of ``axes``."""
        beyond = [not axes.issuperset(frame) for frame in self.frames]
        if not any(beyond):
            return None
        index = int(np.array(beyond)[self.frame].argmax())
        return int(self.lines[index]), self.frames[int(self.frame[index])]

    def motion_lines(self) -> list[MotionLine]:
        """Return the lines as objects."""
        points = self.points.tolist()
        places = [tuple(self.axes.index(axis) for axis in frame) for frame in self.frames]
        speeds = [None] * len(self) if self.speeds is None else self.speeds.tolist()
        found = []
        for index, (line, frame, centre, sweep, length, travel, requested, tolerance) in enumerate(
            zip(
                self.lines.tolist(),
                self.frame.tolist(),
                self.centres.tolist(),
                self.sweeps.tolist(),
                self.lengths.tolist(),
                self.travels.tolist(),
                self.requested.tolist(),
                self.tolerances.tolist(),
                strict=True,
            )
        ):
            before, after, columns = points[index], points[index + 1], places[frame]
            start = tuple([before[column] for column in columns])
            end = tuple([after[column] for column in columns])
            curve: Curve
            if self.tips is not None:
                curve = self.tips.line(index, self.frames[frame], (start, end), length)
            elif sweep:
                curve = ArcCurve(self.frames[frame], start, end, (centre[0], centre[1]), sweep, length)
            else:
                curve = LineCurve(self.frames[frame], start, end, length)
            duration = requested if self.speeds is None else None
            group = FeedGroup((curve,), requested, duration, speeds[index], carried=self.carried)
            found.append(MotionLine(line, (group,), self.exact_stop, tolerance, travel))
        return found

    def values(self) -> list[MotionLine | OutputLine]:
        """Return the lines as objects, each behind the outputs that its S sets."""
        lines = self.motion_lines()
        if self.outputs is None:
            return [*lines]
        found: list[MotionLine | OutputLine] = []
        for each, speed in zip(lines, self.outputs.values.tolist(), strict=True):
            settings = self.outputs.settings(speed)
            found += [OutputLine(each.line, settings, with_motion=True), each] if settings else [each]
        return found


class AxisLine(msgspec.Struct, frozen=True):
    """An axis command (G1000-G1011, G1060, G1061), executed once the motion before it has ended.

    A line with several axis commands gives one AxisLine each, in reading order.
    """

    line: int
    operation: AxisOperation
    axes: tuple[int, ...]


class ProbeKind(enum.IntEnum):
    """G38.2 … G38.5 (D-74)."""

    TOWARDS = 2  # until contact; a fault without it
    TOWARDS_OR_ON = 3  # until contact or the target
    AWAY = 4  # until contact is lost; a fault otherwise
    AWAY_OR_ON = 5

    @property
    def towards(self) -> bool:
        """Whether the move ends when contact is made, not lost."""
        return self in (ProbeKind.TOWARDS, ProbeKind.TOWARDS_OR_ON)

    @property
    def needs(self) -> bool:
        """Whether reaching the target without that change of contact is a fault."""
        return self in (ProbeKind.TOWARDS, ProbeKind.AWAY)


class ProbeLine(msgspec.Struct, frozen=True):
    """G38: a straight move that ends where the probe's contact changes; the next move starts there.

    Attributes:
        targets: of ``axes`` [m or rad]. speed: along the line [m/s]. requested: T to the targets [s].
        length: to the targets [m]. mesh: what it meets is a point of the mesh of the bed, and a rapid of its
            axis is behind it.
    """

    line: int
    kind: ProbeKind
    axes: tuple[int, ...]
    targets: tuple[float, ...]
    speed: float
    requested: float
    length: float
    mesh: bool = False


class MeshUse(enum.IntEnum):
    """What becomes of the mesh of a printer's bed (D-144)."""

    OFF = 0
    ON = 1
    MET = 2  # it is what was probed, and counts

    def behind(self, held: frozenset[MeshUse]) -> frozenset[MeshUse]:
        """Return what holds behind it: ON or OFF, and MET where the mesh has been probed at all."""
        if self is MeshUse.OFF:
            return held - {MeshUse.ON} | {self}
        return held - {MeshUse.OFF} | {MeshUse.ON, self}


# what holds until a program says otherwise: the mesh of the machine file
MESH_OF_FILE = frozenset({MeshUse.ON})


class MeshLine(msgspec.Struct, frozen=True):
    """The mesh of the bed counts otherwise behind it; ``axes``: that it is of, and lies over."""

    line: int
    use: MeshUse
    axes: tuple[int, ...]


class ThreadLine(msgspec.Struct, frozen=True):
    """G33: a straight move from rest to rest, synchronized to the angle of the spindle (D-89).

    Attributes:
        targets: of ``axes`` [m]. length: to the targets [m]. pitch: travel along the line per turn [m].
        spindle: its axis. turns_s: its programmed speed S, negative under M4 [1/s].
        taps: rigid tapping: at the targets the spindle reverses and the axes return to the start (D-89).
    """

    line: int
    axes: tuple[int, ...]
    targets: tuple[float, ...]
    length: float
    pitch: float
    spindle: int
    turns_s: float
    taps: bool = False

    @property
    def requested(self) -> float:
        """T that the pitch and S ask for [s]."""
        return self.travel / (self.pitch * abs(self.turns_s))

    @property
    def travel(self) -> float:
        """Distance that the axes cover, there and back when tapping [m]."""
        return 2.0 * self.length if self.taps else self.length


class PauseLine(msgspec.Struct, frozen=True):
    """M00, M01 or a tool change: motion ends, then the program waits to be resumed.

    Attributes:
        notice: what the operator has to do; empty: show the line's comment, if any.
        tool: tool to fit, 0 to fit none; None: not a tool change.
    """

    line: int
    notice: str = ""
    tool: int | None = None


class WaitMode(enum.IntEnum):
    """What M66 waits for; numbers of its word L."""

    IMMEDIATE = 0
    RISE = 1
    FALL = 2
    HIGH = 3
    LOW = 4


class InputLine(msgspec.Struct, frozen=True):
    """M66: motion ends, then an input is read, or waited for up to ``timeout`` [s] (D-72)."""

    line: int
    column: int
    mode: WaitMode
    timeout: float


class EndLine(msgspec.Struct, frozen=True):
    """M02 or M30."""

    line: int


Canonical = (
    MotionLine | AxisLine | ProbeLine | MeshLine | ThreadLine | PauseLine | OutputLine | InputLine | EndLine
)


def requested_of(line: MotionLine) -> float | None:
    """Return a line's requested time, the longest of its groups' [s]; None where no group requests one."""
    times = [
        group.requested if isinstance(group, FeedGroup) else group.seconds
        for group in line.groups
        if isinstance(group, FeedGroup | DwellGroup)
    ]
    times = [time for time in times if math.isfinite(time)]
    return max(times) if times else None


def dwell_of(line: MotionLine) -> float:
    """Return the dwell of a line that only dwells, else 0 [s]."""
    (first, *others) = line.groups or (None,)
    return first.seconds if isinstance(first, DwellGroup) and not others else 0.0


def moves_axes(line: MotionLine) -> bool:
    """Return whether a line counts as motion for M62: G00 to G03, or G1020."""
    return any(isinstance(group, FeedGroup | RapidGroup) for group in line.groups)


def may_flow(line: MotionLine) -> bool:
    """Return whether a line may join its neighbours without a stop (D-32).

    It may if it is one feed group, or several feed groups without an exact stop.
    """
    feeds = sum(isinstance(group, FeedGroup) for group in line.groups)
    return feeds == len(line.groups) > 0 and (feeds == 1 or not line.exact_stop)


def in_one_time(groups: Sequence[FeedGroup]) -> list[FeedGroup]:
    """Merge groups with the same T into one that shares a path fraction (D-32)."""
    found: list[FeedGroup] = []
    for group in groups:
        for index, other in enumerate(found):
            timed = (group.duration is None) == (other.duration is None)
            one_time = math.isclose(group.requested, other.requested, rel_tol=SAME_TIME)
            if timed and one_time and group.requested > 0.0:
                found[index] = msgspec.structs.replace(other, curves=other.curves + group.curves)
                break
        else:
            found.append(group)
    return found


def one_path(line: MotionLine) -> FeedGroup | None:
    """Return a line's feed groups as one group; None where they are no single path, or not all feed groups.

    Several are one path if they have the same T, and do not end in an exact stop.
    """
    groups = [group for group in line.groups if isinstance(group, FeedGroup)]
    merged = in_one_time(groups)
    several = len(groups) > 1
    if len(groups) < len(line.groups) or len(merged) != 1 or (several and line.exact_stop):
        return None
    return merged[0]
