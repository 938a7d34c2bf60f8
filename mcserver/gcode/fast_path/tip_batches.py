"""Interpret lines of G01 that lead a tool in columns: of arms and legs, and of the tip under G43.4.

As the block interpreter does line by line, but for the last bits: sums of matrices are taken of many at once.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from mckinematics.errors import KinematicsError
from mckinematics.even_path import EvenPaths
from mckinematics.pose import Pose

from mcserver.gcode.fast_path.arc_columns import hypot
from mcserver.gcode.fast_path.code_text import CodeText
from mcserver.gcode.fast_path.interpreted_batch import MIN_LINES, InterpretedBatch, leading, state_after
from mcserver.gcode.fast_path.usable_lines import Kind, places, speed_outputs, usable_lines
from mcserver.gcode.fast_path.vocabulary import Vocabulary
from mcserver.gcode.fast_path.word_columns import WordReader
from mcserver.gcode.semantics.block_state import Setup
from mcserver.gcode.semantics.commanded_state import CommandedState
from mcserver.gcode.semantics.feed_time import FeedBasis
from mcserver.gcode.semantics.modal import ModalState
from mcserver.gcode.semantics.program_units import axis_scale, move_duration
from mcserver.gcode.semantics.tip_lines import tip_columns
from mcserver.gcode.semantics.tip_moves import tip_frame
from mcserver.gcode.semantics.tool_moves import NO_TRAVEL
from mcserver.gcode.semantics.tool_pose import commanded_pose
from mcserver.gcode.semantics.travel_limits import ROUNDING
from mcserver.motion.canonical import PathBatch
from mcserver.motion.geometry.curves import Array, TipColumns, ToolRates
from mcserver.units import AxisType

# lines that are solved together, so that a line which goes another way wastes few
_FIRST_BLOCK, _LARGEST_BLOCK = 8, 256


class _Led(NamedTuple):
    """A tool that lines lead.

    Attributes:
        axes: numbers by which words name its coordinates. start: of these at the first line [m or rad].
        linear: whether each is a length. least, greatest: that words may have. shifted: they count from the
            program's zero.
        chain: axes of its joints. own: its tolerances [m, rad]. rates: of the tip by those of the joints.
        solve: the lines between coordinates, shape (n+1, C), from joints (K,) on.
    """

    axes: tuple[int, ...]
    start: Array
    linear: tuple[bool, ...]
    least: Array
    greatest: Array
    shifted: bool
    chain: tuple[int, ...]
    own: tuple[float, float]
    rates: ToolRates
    solve: Callable[[Array, Array], EvenPaths]


class TipBatchInterpreter:
    """Interprets batches of lines that lead a tool."""

    __slots__ = ("_reader", "_setup", "_vocabulary")

    def __init__(self, setup: Setup, vocabulary: Vocabulary) -> None:
        self._setup = setup
        # [n] names an axis, not a coordinate of the tool (D-52)
        self._vocabulary = vocabulary._replace(indexed=False)
        self._reader = WordReader(self._vocabulary)

    def interpret(
        self, text: CodeText, number: int, modal: ModalState, commanded: CommandedState
    ) -> InterpretedBatch | None:
        """Interpret the batch at the beginning of the text, and advance the positions.

        Args:
            number: of the first line.
        """
        tolerance = self._setup.machine.corner_tolerance(modal.tolerance)
        if modal.tool is not None and tolerance <= 0.0:
            # nothing is smoothed
            return None
        try:
            led = self._led(modal, commanded)
        except KinematicsError:
            return None
        if led is None:
            return None
        table = self._reader.read(text, MIN_LINES)
        if table is None:
            return None
        kinds = [
            Kind(led.chain, shape.curved, FeedBasis.PATH) if set(shape.axes) <= set(led.axes) else None
            for shape in table.shapes
        ]
        lines = usable_lines(table, kinds, modal, self._setup, self._vocabulary)
        coordinates = np.column_stack(
            [
                places(
                    lines.table,
                    axis,
                    float(start),
                    axis_scale(AxisType.LINEAR if linear else AxisType.ROTARY, modal.inch),
                    modal,
                    shifted=led.shifted,
                )
                for axis, start, linear in zip(led.axes, led.start, led.linear, strict=True)
            ]
        )
        travels = hypot(*np.diff(coordinates[:, :3], axis=0).T)
        sound = (lines.motion == 1) & (travels > NO_TRAVEL)
        inside = np.asarray(((coordinates >= led.least) & (coordinates <= led.greatest)).all(axis=1))
        sound &= inside[:-1] & inside[1:]
        count = leading(sound)
        joints, tips, tolerances = self._solved(
            led, coordinates[: count + 1], commanded, tolerance, exact_stop=modal.exact_stop
        )
        count = len(tips)
        lines, travels = lines.first(count), travels[:count]
        if count < MIN_LINES:
            return None
        batch = PathBatch(
            lines=number + lines.table.lines,
            axes=led.chain,
            points=joints,
            frames=(led.chain,),
            frame=np.zeros(count, np.intp),
            centres=np.full((count, 2), np.nan),
            sweeps=np.zeros(count),
            lengths=travels,
            travels=travels,
            requested=move_duration(lines.numbers) if modal.inverse_time else travels / lines.speeds,
            speeds=None if modal.inverse_time else lines.speeds,
            tolerances=tolerances,
            exact_stop=modal.exact_stop,
            outputs=speed_outputs(lines.table, modal, self._vocabulary),
            tips=tips,
            carried=modal.carried,
        )
        commanded.positions.update(zip(led.chain, batch.points[-1].tolist(), strict=True))
        for axis in led.chain:
            commanded.stale.update(self._setup.tools_of[axis])
        if modal.tool is not None:
            x, y, z, *angles = coordinates[count].tolist()
            a, b, c = angles or commanded.poses[modal.tool].angles
            commanded.poses[modal.tool] = Pose((x, y, z), (a, b, c))
            commanded.stale.discard(modal.tool)
        after = state_after(modal, lines.table.feeds, lines.table.spindle, 1)
        return InterpretedBatch(after, (batch,), lines.table.taken, lines.table.without_effect(number))

    def _solved(
        self, led: _Led, coordinates: Array, commanded: CommandedState, tolerance: float, *, exact_stop: bool
    ) -> tuple[Array, TipColumns, Array]:
        """Return the lines up to one on which joints must not go evenly.

        Returns:
            The joints at their ends, shape (n+1, K), and what `tip_columns` has.
        """
        chain = [self._setup.axes[axis] for axis in led.chain]
        joints = [np.array([[commanded.positions[axis] for axis in led.chain]])]
        parts: list[TipColumns] = []
        tolerances = [np.empty(0)]
        first, size = 0, _FIRST_BLOCK
        while first < len(coordinates) - 1:
            block = coordinates[first : first + size + 1]
            try:
                found = led.solve(block, joints[-1][-1])
            except KinematicsError:
                break
            tips, left = tip_columns(chain, found, led.own, tolerance, led.rates, exact_stop=exact_stop)
            joints.append(found.joints[1 : len(tips) + 1])
            parts.append(tips)
            tolerances.append(left)
            if len(tips) < len(block) - 1:
                break
            first, size = first + size, min(2 * size, _LARGEST_BLOCK)
        return np.concatenate(joints), TipColumns.joined(led.rates, parts), np.concatenate(tolerances)

    def _led(self, modal: ModalState, commanded: CommandedState) -> _Led | None:
        """Return the tool in force; None where the block interpreter has to lead it.

        Raises:
            KinematicsError: it has no pose.
        """
        by_tip = modal.tool is None
        tool = modal.tool
        if by_tip and modal.frame is not None and not modal.frame.by_direction:
            tool = modal.frame.tip_tool
        setup = self._setup
        if tool is None or setup.kinematics is None or tool not in setup.chains:
            return None
        chain = setup.chains[tool]
        known = commanded.starts.keys() | commanded.unsynced.keys() | commanded.guessed
        if not known.isdisjoint(chain) or not setup.leased.issuperset(chain):
            return None
        if any(setup.axes[axis].profiled for axis in chain):
            return None
        return self._led_by_tip(modal, commanded) if by_tip else self._led_tool(tool, commanded)

    def _led_tool(self, tool: int, commanded: CommandedState) -> _Led:
        """Return a tool that T selects: X Y Z A B C are its pose (D-50)."""
        setup = self._setup
        kinematics = setup.kinematics
        assert kinematics is not None
        chain, oriented = setup.chains[tool], kinematics.has_orientation(tool)
        pose = commanded_pose(kinematics, tool, setup.machine, commanded)
        count = 6 if oriented else 3

        def solve(coordinates: Array, joints: Array) -> EvenPaths:
            angles = coordinates[:, 3:] if oriented else None
            return kinematics.solve_even_paths(
                tool, coordinates[:, :3], angles, dict(zip(chain, joints.tolist(), strict=True))
            )

        return _Led(
            tuple(range(count)),
            np.array((*pose.position, *pose.angles)[:count]),
            (True, True, True, False, False, False)[:count],
            np.full(count, -np.inf),
            np.full(count, np.inf),
            False,
            chain,
            kinematics.tolerances(tool),
            partial(kinematics.jacobians, tool),
            solve,
        )

    def _led_by_tip(self, modal: ModalState, commanded: CommandedState) -> _Led | None:
        """Return a tool under G43.4: X Y Z are the tip's on the work piece, beside the rotary axes (D-86)."""
        setup = self._setup
        assert modal.frame is not None
        frame = tip_frame(setup, modal.frame)
        control = frame.control
        chain = control.tool.chain.axes
        turning = [setup.axes[axis] for axis in frame.turning]
        if any(axis.rollover is not None for axis in turning):
            return None
        joints = np.array([commanded.positions[axis] for axis in chain])

        def solve(coordinates: Array, start: Array) -> EvenPaths:
            return control.even_paths(frame.points(coordinates[:, :3]), coordinates[:, 3:], start)

        return _Led(
            (0, 1, 2, *frame.turning),
            np.array((*frame.coordinates(joints), *joints[control.turning])),
            (True, True, True, *(False for _ in turning)),
            np.array((*[-np.inf] * 3, *(axis.min_position - ROUNDING for axis in turning))),
            np.array((*[np.inf] * 3, *(axis.max_position + ROUNDING for axis in turning))),
            True,
            chain,
            (control.tool.tolerance, control.tool.tolerance_angle),
            control.rates,
            solve,
        )
