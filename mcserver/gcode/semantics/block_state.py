"""The state of one block (line) while it is interpreted: modal state, positions, and its faults."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType

import msgspec
from mckinematics.dynamics import JointDynamics
from mckinematics.pose import Kinematics

from mcserver.gcode.line_faults import FaultList, Span
from mcserver.gcode.profiles.frame import Frame
from mcserver.gcode.profiles.transformation import Transformation
from mcserver.gcode.semantics.arc_geometry import RadiusTolerance, radius_tolerance
from mcserver.gcode.semantics.commanded_state import CommandedState
from mcserver.gcode.semantics.compensation_state import Compensation
from mcserver.gcode.semantics.modal import Feed, ModalState, with_frame
from mcserver.gcode.switches import AS_WRITTEN, Switches
from mcserver.gcode.text.parser import ParsedLine
from mcserver.gcode.text.profile_words import Action, ProfileWord
from mcserver.gcode.text.syntax import Command
from mcserver.gcode.text.words import Word
from mcserver.machine.axis import Axis
from mcserver.machine.follow_section import Superimposed
from mcserver.machine.machine_file import Machine

# replaces a feed that could not be read, so that later lines have no fault for it; only in checks
ASSUMED_FEED = Feed(1.0, 1.0)
ASSUMED_TOOL = -1


class Setup(msgspec.Struct, frozen=True):
    """Tables that stay constant while a program runs.

    Attributes:
        axes: of the machine, by number.
        leased: axes that the program may use.
        chains: axes of each tool, in its chain's order.
        tools_of: tools that use an axis.
        dynamics: of joints with torque limits; None without any.
        switches: of the operator.
    """

    machine: Machine
    kinematics: Kinematics | None
    axes: Mapping[int, Axis]
    leased: frozenset[int]
    chains: Mapping[int, tuple[int, ...]]
    tools_of: Mapping[int, tuple[int, ...]]
    dynamics: JointDynamics | None = None
    switches: Switches = AS_WRITTEN


def set_up(
    machine: Machine,
    kinematics: Kinematics | None,
    lease: frozenset[int] | None,
    switches: Switches = AS_WRITTEN,
) -> Setup:
    """Build the tables for a machine; without a lease the program may use all axes."""
    # the second drive of a gantry cannot be programmed
    axes = {axis.index: axis for axis in machine.axes if axis.gantry is None}
    dynamics = None if kinematics is None else kinematics.dynamics
    chains = {} if kinematics is None else {tool: tuple(kinematics.axes(tool)) for tool in kinematics.tools}
    return Setup(
        machine=machine,
        kinematics=kinematics,
        axes=MappingProxyType(axes),
        leased=frozenset(axes) if lease is None else frozenset(axes) & lease,
        chains=MappingProxyType(chains),
        tools_of=MappingProxyType(
            {axis: tuple(tool for tool, chain in chains.items() if axis in chain) for axis in axes}
        ),
        dynamics=dynamics if dynamics is not None and dynamics.limited else None,
        switches=switches,
    )


class BlockState:
    """A line's effect on the state, committed only if it has no fault (D-04)."""

    def __init__(
        self,
        setup: Setup,
        parsed: ParsedLine,
        modal: ModalState,
        commanded: CommandedState,
        compensation: Compensation | None = None,
    ) -> None:
        self.setup = setup
        self.parsed = parsed
        self.modal = modal
        self.commanded = commanded.copy()
        self.compensation = compensation
        self.faults = FaultList(parsed.number, parsed.origin)
        self.moved: dict[int, Command] = {}
        self.exact_stop = False
        self.tolerance = 0.0
        self.feed_length = 0.0

    @property
    def faulty(self) -> bool:
        """Whether the line has a fault so far, and not only warnings."""
        return any(fault.severity == "error" for fault in (*self.parsed.faults, *self.faults.found))

    @property
    def path_tolerance(self) -> float:
        """Path tolerance in force for corners [m]."""
        return self.setup.machine.corner_tolerance(self.modal.tolerance)

    @property
    def arc_tolerance(self) -> RadiusTolerance:
        """Allowed difference of an arc's start and end radius (D-22)."""
        return radius_tolerance(self.setup.machine.dialect.profile, inch=self.modal.inch)

    def change(self, **fields: object) -> None:
        """Replace fields of the modal state."""
        self.modal = msgspec.structs.replace(self.modal, **fields)

    @property
    def frame(self) -> Frame:
        """The frame in force; setting it moves the program's zero."""
        return self.modal.frame or Frame()

    @frame.setter
    def frame(self, frame: Frame) -> None:
        before = self.modal.shift or {}
        if frame.cycle is not None and frame.directions != self.frame.directions:
            # its heights are along the old directions
            frame = msgspec.structs.replace(frame, cycle=None)
        self.modal = with_frame(self.modal, frame)
        after = self.modal.shift or {}
        if self.modal.transformation is not None and before != after:
            moved = {axis for axis in before.keys() | after.keys() if before.get(axis) != after.get(axis)}
            self.transformation = self.transformation.without(moved)

    @property
    def transformation(self) -> Transformation:
        """Rotation, scaling and polar coordinates in force; setting one without effect removes it."""
        return self.modal.transformation or Transformation()

    @transformation.setter
    def transformation(self, found: Transformation) -> None:
        self.change(transformation=None if found.idle else found)

    @property
    def drilling(self) -> bool:
        """Whether a canned cycle is in force, which axis words without a code repeat (D-75)."""
        frame = self.modal.frame
        return self.modal.motion is None and frame is not None and frame.cycle is not None

    def end_motion_code(self) -> None:
        """End the motion code or cycle in force, so that axis words without a code repeat none."""
        self.change(motion=None, spline_end=None, control_points=None)
        if self.frame.cycle is not None:
            self.frame = msgspec.structs.replace(self.frame, cycle=None)

    def span(self, source: Word | Command | ProfileWord | Action) -> Span:
        """Return the columns of a word or of a command; only computed for faults."""
        if isinstance(source, Action | ProfileWord):
            return source.span
        if isinstance(source, Word):
            return self.parsed.span(source.index)
        return self.parsed.command_span(source)

    def refuse_missing_axis(self, index: int, source: Word | Command | ProfileWord | Action) -> None:
        """Report an axis that programs cannot name (MC108): it does not exist, or is a second drive."""
        machine = self.setup.machine
        axis = machine.axis(index)
        if axis is not None and axis.gantry is not None:
            leader = axis.gantry.leader
            message = f"axis {index} is the second drive of axis {leader}, and moves with it"
            hint = f"name axis {leader}"
        else:
            known = ", ".join(str(number) for number in sorted(self.setup.axes))
            message, hint = f"the machine {machine.name} has no axis {index}", f"its axes are {known}"
        self.faults.add("MC108", message, self.span(source), hint, axis=index)

    def refuse_twice(self, word: ProfileWord) -> None:
        """Report a word that an action has already (MC111)."""
        self.faults.add("MC111", f"{word.letter} stands twice in one command", word.span, "keep one of them")

    def superimposed(self, index: int) -> Superimposed | None:
        """Return the axis's motion that is superimposed on the program's (D-142); None without one."""
        follows = any(index == each for each, _ in self.modal.coupled)
        return self.setup.axes[index].superimposed if follows else None

    def usable_axis(
        self, index: int, source: Word | Command | Action, *, coupled: bool = False, along: bool = False
    ) -> Axis | None:
        """Return the axis; None after a fault: MC108 (not on the machine), MC109 (not leased), MC345 (it
        follows another one).

        Args:
            coupled: a follower is allowed. along: so is one with superimposed motion.
        """
        axis = self.setup.axes.get(index)
        if axis is None:
            self.refuse_missing_axis(index, source)
            return None
        if index not in self.setup.leased:
            known = ", ".join(str(number) for number in sorted(self.setup.leased)) or "none"
            self.faults.add(
                "MC109",
                f"axis {index} is not among the axes that this program has leased",
                self.span(source),
                f"it has {known}; open the program with axis {index} too",
                axis=index,
            )
            return None
        # of a tool that follows, its joints
        besides = axis.reserved is not None
        since = dict(self.modal.coupled).get(index)
        if since is not None and not (coupled or (along and besides)):
            what = "moves a tool that follows another axis" if axis.follow is None else "follows another one"
            self.faults.add(
                "MC345",
                f"axis {index} {what} since line {since}: "
                f"{'only G0 to G3 and G1020 move it besides' if besides else 'nothing else moves it'}",
                self.span(source),
                f"uncouple it before: G1061 P{index}",
                axis=index,
            )
            return None
        return axis

    def claim(self, axes: Iterable[int], command: Command, words: Mapping[int, Word]) -> None:
        """Mark axes as moved by a command; report those that an earlier command of the line moves (D-02)."""
        unnamed: list[int] = []
        for axis in axes:
            earlier = self.moved.get(axis)
            self.moved[axis] = command
            if earlier is None or earlier is command:
                continue
            word = words.get(axis)
            if word is None:
                unnamed.append(axis)
            else:
                self._moved_twice([axis], self.span(word))
        if unnamed:
            self._moved_twice(unnamed, self.span(command))

    def _moved_twice(self, axes: list[int], span: Span) -> None:
        names = ", ".join(str(axis) for axis in axes)
        self.faults.add(
            "MC114",
            f"{'axis' if len(axes) == 1 else 'axes'} {names} would be moved by two commands of one line",
            span,
            "put the second command on a line of its own",
            axis=axes[0],
        )

    def end_at(self, axis: int, end: float) -> None:
        """Set the end of a direct move, which makes the poses of tools with this axis stale (D-50)."""
        self.commanded.end_at(axis, end)
        self.commanded.stale.update(self.setup.tools_of[axis])
