"""``follow`` of an axis: the electronic gear or cam by which it follows another one while it is coupled.

A superimposed follower goes after its leader besides what programs order it: X of a gantry over a conveyor,
or, with a ``follow`` of its own, the tool of an arm. A share of the axes' limits is kept for that.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Literal

import msgspec
from msgspec import Meta

from mcserver.machine.constraints import LEAST_STEP, Positive, ascending
from mcserver.machine.section_reader import Mistakes
from mcserver.machine.toml_positions import Path
from mcserver.units import MM

if TYPE_CHECKING:
    from mcserver.machine.axis import Axis
    from mcserver.machine.clearance_section import Body
    from mcserver.machine.tool_section import Tool

# Numbers beyond this are no places, and squares of them might be no numbers at all.
MOST_NUMBER = 1e9

_Number = Annotated[
    float, Meta(ge=-MOST_NUMBER, le=MOST_NUMBER, description="numbers are a thousand million at most")
]
_CamPoint = Annotated[
    list[_Number],
    Meta(min_length=2, max_length=3, description="[leader, this axis] or [leader, this axis, slope]"),
]


class FollowSection(msgspec.Struct, frozen=True):
    """``follow`` as written.

    Attributes:
        leader: number of the axis that is followed.
        tolerance: by which this axis may be beside the place that the leader gives it [mm, deg].
        ratio: of a gear: mm or deg of this axis for each mm or deg of the leader.
        cam: points of a cam, ascending: where the leader is, where this axis is then, and the slope there.
        repeats: the cam goes on and on, each time further by what it has climbed.
        source: of the leader's place: what it is ordered, or what its encoder reads.
        superimposed: programs move the axis, too, and what the leader gives is added to that.
        window: of a superimposed one, from where to where it may be moved by its leader [mm, deg].
        reserve: of a superimposed one, share of velocity, acceleration and jerk that is kept from programs.
        latch: of a superimposed one, number of the digital input whose rise notes where the leader is.
        after: way of the leader from there to where the axis begins to follow [mm, deg].
    """

    leader: int
    tolerance: Positive
    ratio: _Number | None = None
    cam: Annotated[list[_CamPoint], Meta(max_length=2000, description="2 to 2000 points")] | None = None
    repeats: bool = False
    source: Literal["setpoint", "encoder"] = "setpoint"
    superimposed: bool = False
    window: Annotated[list[_Number], Meta(min_length=2, max_length=2)] | None = None
    reserve: Annotated[float, Meta(ge=0.05, le=0.95)] = 0.5
    latch: Annotated[int, Meta(ge=0)] | None = None
    after: _Number = 0.0


class ToolFollowSection(msgspec.Struct, frozen=True):
    """``follow`` of a tool as written: it is superimposed, and its keys are those of `FollowSection`.

    Attributes:
        direction: how the tip goes for each mm or deg of the leader, in the frame of the tool's poses [mm].
    """

    leader: int
    tolerance: Positive
    direction: tuple[_Number, _Number, _Number]
    window: Annotated[list[_Number], Meta(min_length=2, max_length=2)]
    source: Literal["setpoint", "encoder"] = "setpoint"
    reserve: Annotated[float, Meta(ge=0.05, le=0.95)] = 0.5
    latch: Annotated[int, Meta(ge=0)] | None = None
    after: _Number = 0.0

    @property
    def along(self) -> FollowSection:
        """The same along the direction, as of a linear axis."""
        return FollowSection(
            self.leader,
            self.tolerance,
            math.hypot(*self.direction),
            source=self.source,
            superimposed=True,
            window=self.window,
            reserve=self.reserve,
            latch=self.latch,
            after=self.after,
        )


class Superimposed(msgspec.Struct, frozen=True):
    """What an axis, or a tool, does for its leader besides what programs order, in SI.

    Attributes:
        low, high: from where to where, 0 between them. reserve: share of limits that is kept for it.
        latch: column of the input that notes the leader's place; None: the place is that at G1060.
        after: way of the leader from that place to where it is followed.
    """

    low: float
    high: float
    reserve: float
    latch: int | None
    after: float


class Follow(msgspec.Struct, frozen=True):
    """The same in SI; a gear has no ``cam``, a cam no ratio. ``measured``: the leader's encoder counts.

    ``superimposed``: None: programs do not move the axis while it follows. ``direction``: of a tool's tip, a
    unit vector in the frame of its poses; (): an axis follows.
    """

    leader: int
    tolerance: float
    ratio: float | None
    cam: tuple[tuple[float, float, float], ...]
    repeats: bool
    measured: bool
    superimposed: Superimposed | None = None
    direction: tuple[float, ...] = ()


def check_followers(
    axes: Mapping[Path, Axis],
    sections: Mapping[Path, FollowSection | None],
    tools: Sequence[Tool],
    carried: Mapping[int, tuple[Path, ToolFollowSection]],
    bodies: Sequence[Body | None],
    digital: Mapping[int, int],
    mistakes: Mistakes,
) -> tuple[dict[int, Follow], dict[int, Follow]]:
    """Return what axes follow, in SI, by their numbers, and what tools do; note those that cannot: MC094.

    Args:
        axes, sections: by the paths of the axes' sections. carried: those of tools, by number, with their
            paths. digital: columns of digital inputs by number.
    """
    numbers = {axis.index: axis for axis in axes.values()}
    # a tool follows with all its joints
    joints = {index for tool in tools if tool.number in carried for index in tool.axes}
    following = {axes[path].index for path, section in sections.items() if section is not None} | joints
    # of gantry pairs an axis may follow the leader, and none of the two follows
    seconds = {axis.index for axis in axes.values() if axis.gantry is not None}
    pairs = seconds | {axis.gantry.leader for axis in axes.values() if axis.gantry is not None}

    def leader_of(path: Path, index: int) -> Axis | None:
        leader = numbers.get(index)
        if leader is not None and leader.index not in following | seconds:
            return leader
        why = "is the second drive of a gantry" if index in seconds else "follows another one itself"
        mistakes.add(
            (*path, "follow", "leader"),
            f"axis {index} {why if index in numbers else 'is not there'}",
            "name an [[axis]] of this file that programs or others move",
            "MC094",
        )
        return None

    found: dict[int, Follow] = {}
    for path, section in sections.items():
        leader = None if section is None else leader_of(path, section.leader)
        if section is None or leader is None:
            continue
        axis = axes[path]
        what = (
            _wrong_mechanics(axis, leader, section, tools, bodies)
            or _wrong_table(section)
            or _wrong_window(section, digital)
        )
        if axis.index in pairs:
            what = "it is one of a gantry pair", "let another axis follow"
        if what is not None:
            mistakes.add((*path, "follow"), *what, "MC094")
            continue
        found[axis.index] = _in_si(section, axis.type.si_per_unit, leader, digital)
    tips: dict[int, Follow] = {}
    for tool in tools:
        path, given = carried.get(tool.number, ((), None))
        leader = None if given is None else leader_of(path, given.leader)
        if given is None or leader is None:
            continue
        moved = [numbers[index] for index in tool.axes if index in numbers]
        what = _wrong_tool(tool, given, [each for each in tools if each is not tool], carried)
        what = what or _wrong_shapers(moved, leader, given.source) or _wrong_window(given.along, digital)
        if what is not None:
            mistakes.add((*path, "follow"), *what, "MC094")
            continue
        follow = _in_si(given.along, MM, leader, digital)
        length = math.hypot(*given.direction)
        direction = tuple(each / length for each in given.direction)
        tips[tool.number] = msgspec.structs.replace(follow, direction=direction)
    return found, tips


def _in_si(section: FollowSection, mine: float, leader: Axis, digital: Mapping[int, int]) -> Follow:
    """Return a section in SI; ``mine``: SI of a mm or degree of what follows."""
    its, superimposed = leader.type.si_per_unit, None
    if section.superimposed:
        low, high = section.window or (0.0, 0.0)
        latch = None if section.latch is None else digital[section.latch]
        superimposed = Superimposed(low * mine, high * mine, section.reserve, latch, section.after * its)
    return Follow(
        leader.index,
        section.tolerance * mine,
        None if section.ratio is None else section.ratio * mine / its,
        tuple(
            (place * its, value * mine, slope * mine / its)
            for place, value, slope in cam_points(section.cam or [], repeats=section.repeats)
        ),
        section.repeats,
        section.source == "encoder",
        superimposed,
    )


def _wrong_tool(
    tool: Tool,
    section: ToolFollowSection,
    others: Sequence[Tool],
    carried: Mapping[int, tuple[Path, ToolFollowSection]],
) -> tuple[str, str] | None:
    """Return why a tool cannot follow, and the remedy; None: it can."""
    if not math.hypot(*section.direction) > 0.0:
        return "its direction is 0 0 0", "give the mm along X Y Z that its tip goes for each of the leader"
    beside = [each for each in others if set(each.axes) & set(tool.axes)]
    if any(each.number in carried for each in beside):
        return "another tool with follow has one of its joints", "let one of the two follow"
    if beside and not tool.orientation:
        # their tips would go another way as the joints turn
        return "other tools have its joints, and it keeps no orientation", "set orientation = true for it"
    return None


def _wrong_mechanics(
    axis: Axis, leader: Axis, section: FollowSection, tools: Sequence[Tool], bodies: Sequence[Body | None]
) -> tuple[str, str] | None:
    """Return why an axis cannot follow, and the remedy; None: it can."""
    if axis.profiled:
        return "a drive makes its profiles itself", 'use csp or ip for both: mode = "pp" goes to points'
    if axis.index in {each for tool in tools for each in tool.axes}:
        return "a [[tool]] names this axis", "how its tip moves would not be known beforehand"
    if any(body is not None and axis.index in body.carried_by for body in bodies):
        return "a [[body]] is carried by this axis", "where it is would not be known beforehand"
    return _wrong_shapers([axis], leader, section.source)


def _wrong_shapers(axes: Sequence[Axis], leader: Axis, source: str) -> tuple[str, str] | None:
    """Return that axes would come later or earlier than the leader that they follow, and the remedy."""
    if source == "encoder":
        return None
    if leader.profiled:
        return "the drive of its leader makes its profiles itself", "use csp or ip for it"
    if any((axis.shaper, axis.tool_shapers) != (leader.shaper, leader.tool_shapers) for axis in axes):
        return "its shaper is not that of its leader", "give both the same one"
    return None


def _wrong_table(section: FollowSection) -> tuple[str, str] | None:
    """Return what is wrong with a gear or a cam, and the remedy; None: nothing."""
    cam = section.cam
    if (section.ratio is None) is (cam is None):
        return "it has a ratio and a cam, or neither", "give ratio for a gear, cam for a cam"
    if section.ratio == 0.0:
        return "a gear of ratio 0 stands still", "give another ratio, or leave follow out"
    if cam is None:
        return ("a gear repeats by itself", "leave repeats out") if section.repeats else None
    places = [point[0] for point in cam]
    if len(cam) < 2 or not ascending(places):
        what = (
            f"the cam needs two points or more, with places of the leader that ascend by {LEAST_STEP} or more"
        )
        return what, "sort them, each once"
    if section.repeats and len({point[2] for point in (cam[0], cam[-1]) if len(point) == 3}) > 1:
        return "the slopes at the two ends of a cam that repeats differ", "give the same one, or leave it out"
    if not section.repeats and any(point[2:] not in ([], [0.0]) for point in (cam[0], cam[-1])):
        return (
            "beyond its ends a cam stands, and a slope at an end is not 0",
            "end it at rest, or let it repeat",
        )
    return None


def _wrong_window(section: FollowSection, digital: Mapping[int, int]) -> tuple[str, str] | None:
    """Return what is wrong with the keys of a superimposed follower, and the remedy; None: nothing."""
    window = section.window
    if not section.superimposed:
        given = window is not None or section.latch is not None or section.after
        return ("window, latch and after are of a superimposed one", "leave them out") if given else None
    if section.ratio is None:
        return "a cam has places, and is not superimposed", "give a ratio, or leave superimposed out"
    if window is None or not window[0] <= 0.0 <= window[1] or window[0] == window[1]:
        return "a superimposed one has a window with 0 in it", "such as window = [0.0, 400.0]"
    if section.latch is None:
        return ("it has no latch that comes before", "give latch too") if section.after else None
    if section.latch not in digital:
        return f"there is no digital input {section.latch}", "name an [[input]] of this file"
    return None


def cam_points(points: Sequence[Sequence[float]], *, repeats: bool) -> list[tuple[float, float, float]]:
    """Return the points of a cam with the slopes that are not given.

    They are the harmonic means of those of the chords beside, 0 where these have not one sign: so between
    two points the cam never leaves their values (Butland, A method of interpolating reasonable-shaped curves
    through any data, 1980). At the ends of a cam that does not repeat it stands.
    """
    chords = [(after[1] - before[1]) / (after[0] - before[0]) for before, after in pairwise(points)]
    ends = (chords[-1], chords[0]) if chords and repeats else (0.0, 0.0)
    beside = zip([ends[0], *chords], [*chords, ends[1]], strict=True) if chords else ()
    means = [2.0 * one * other / (one + other) if one * other > 0.0 else 0.0 for one, other in beside]
    given = [point[2] if len(point) == 3 else mean for point, mean in zip(points, means, strict=False)]
    if repeats and points:
        # the ends are one point
        first, last = (len(points[each]) == 3 for each in (0, -1))
        given[0] = given[-1] = given[-1] if last and not first else given[0]
    return [(point[0], point[1], slope) for point, slope in zip(points, given, strict=False)]
