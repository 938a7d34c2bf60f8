"""Parameters that the machine provides: positions, offsets, tools, results of probes and inputs (D-82)."""

from __future__ import annotations

import enum
from collections.abc import Callable, Iterable, Mapping

import msgspec

from mcserver.gcode.computing.expressions import ComputingError
from mcserver.gcode.line_faults import Span
from mcserver.gcode.profiles.directions import back
from mcserver.gcode.profiles.frame import Frame, tool_table
from mcserver.gcode.profiles.transformation import Transformation
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.gcode.semantics.program_units import axis_scale, length_scale
from mcserver.gcode.text.words import INCREMENTAL_LETTERS, axis_letters
from mcserver.machine.work_systems import ANGLE, SYSTEM_NUMBERS
from mcserver.motion.canonical import Canonical, InputLine, MeshLine, MeshUse, ProbeLine, WaitMode
from mcserver.units import DEGREE, MM

_LETTERS = "XYZABCUVW"
_DIGITIZED = 5070
_INPUT = 5399
_TOOL = 5400
_G92_ON = 5210
_SYSTEM = 5220
_OFFSETS_OF_TOOL = 5401
_DIAMETER_OF_TOOL = 5410
_POSITIONS = 5420
_MACHINE_POSITIONS = 5021
_PROBE = 5061
# numbered parameters of stored positions: the first of nine, and the key in `Frame.stored`
_STORED = {5161: 28, 5181: 30}
_G92 = 5211
_SYSTEMS = {5221 + 20 * (number - 1): number for number in SYSTEM_NUMBERS.values()}
_NAMES_OF_SYSTEMS = {number: float(name[1:]) * 10.0 for name, number in SYSTEM_NUMBERS.items()}


class Source(enum.Enum):
    """Source of values that are measured while the program runs."""

    MACHINE = "machine"  # from the executor, once the motion so far has ended
    ASSUMED = "assumed"  # by a check: a probe trips at the end of its move
    NOWHERE = "nowhere"  # for lines run before: their measurements are not known


class Unsettled(Exception):
    """A value is not known before the motion so far has ended.

    Attributes:
        axes: whose positions have to be read; if empty, the motion only has to end.
    """

    def __init__(self, axes: frozenset[int] = frozenset()) -> None:
        super().__init__()
        self.axes = axes


class _Probe(msgspec.Struct, frozen=True):
    """The last probing move: the program's zero and scale when it began, and its result.

    Attributes:
        transformation: when it began.
        place: positions of all axes, by number [m or rad]; None: it has not ended yet.
    """

    shift: Mapping[int, float]
    inch: bool
    transformation: Transformation = Transformation()
    place: Mapping[int, float] | None = None
    tripped: bool = False


class MachineValues:
    """Values of the machine as they are before the line that reads them.

    Args:
        assume: called with each assumption, in words.
    """

    def __init__(
        self, interpreter: Interpreter, source: Source, assume: Callable[[str], None] = lambda _: None
    ) -> None:
        self._interpreter = interpreter
        self._source = source
        self._assume = assume
        self._machine = interpreter.machine
        letters = axis_letters(self._machine.dialect)
        own = self._machine.dialect.letters
        self._axes = [
            letters.get(letter, -1) if letter not in INCREMENTAL_LETTERS or letter in own else -1
            for letter in _LETTERS
        ]
        self._probe: _Probe | None = None
        # None: still being read
        self._input: float | None = 0.0

    # ------------------------------------------------------------ what is measured

    def interpreted(self, values: Iterable[Canonical]) -> None:
        """Note which measurements a line makes."""
        for value in values:
            if isinstance(value, ProbeLine):
                modal = self._interpreter.modal
                self._probe = _Probe(dict(modal.shift or {}), modal.inch, self._transformation)
                if self._source is Source.ASSUMED:
                    self.probed(self._interpreter.positions, tripped=value.kind.towards)
            elif isinstance(value, MeshLine):
                if value.use is MeshUse.MET and self._source is Source.ASSUMED:
                    probe = self._machine.probe
                    simulated = probe is not None and bool(probe.planes)
                    where = "at simulated_at of [probe]" if simulated else "where it should be"
                    self._assume(f"G29 meets the bed {where}")
            elif isinstance(value, InputLine):
                self._input = None
                if self._source is Source.ASSUMED:
                    initial = self._machine.inputs[value.column].initial
                    waited = {WaitMode.HIGH: 1.0, WaitMode.RISE: 1.0, WaitMode.LOW: 0.0, WaitMode.FALL: 0.0}
                    self._input = waited.get(value.mode, float(initial))

    def probed(self, place: Mapping[int, float], *, tripped: bool) -> None:
        """Store where a probing move tripped or ended [m or rad]."""
        if self._probe is not None:
            self._probe = msgspec.structs.replace(self._probe, place=dict(place), tripped=tripped)

    def input_read(self, value: float) -> None:
        """Store the value that M66 has read."""
        self._input = value

    # ------------------------------------------------------------ values

    def numbered(self, number: int, span: Span) -> float | None:
        """Return a parameter of the machine in the program's units; None if the number is not one.

        Raises:
            ComputingError: MC162 the machine does not have it, MC168. Unsettled: it is not known yet.
        """
        frame = self._interpreter.modal.frame or Frame()
        if _PROBE <= number < _PROBE + 9 or number == _DIGITIZED:
            return self._probed(number, span)
        if number == _INPUT:
            return self._read(span)
        for first, offsets in self._offsets(frame).items():
            if first <= number < first + 9:
                return self._offset(offsets, number - first)
        if number in range(5230, 5391, 20):
            angle = frame.systems.get((number - 5210) // 20, {}).get(ANGLE, 0.0)
            return angle / DEGREE
        if _POSITIONS <= number < _POSITIONS + 9:
            return self.position(number - _POSITIONS, span, absolute=False)
        if _MACHINE_POSITIONS <= number < _MACHINE_POSITIONS + 9:
            return self.position(number - _MACHINE_POSITIONS, span, absolute=True)
        single = {
            _G92_ON: float(frame.g92_on and bool(frame.g92)),
            _SYSTEM: float(frame.system),
            _TOOL: float(frame.changed or 0),
            # faults of a tool changer; there is none
            5600: 0.0,
            5601: 0.0,
        }
        if number in single:
            return single[number]
        if number == _DIAMETER_OF_TOOL:
            fitted = tool_table(self._machine, frame).get(frame.changed or 0)
            return 0.0 if fitted is None else fitted.diameter / MM
        if number >= _PROBE:
            raise ComputingError("MC162", f"#{number} is not known here", span, "see docs/dialect.md, D-82")
        return None

    def named(self, name: str, span: Span) -> float | None:
        """Return a predefined named parameter; None if the name is not one. Raises as `numbered` does."""
        modal, frame = self._interpreter.modal, self._interpreter.modal.frame or Frame()
        if name.startswith("_abs_") and name[5:].upper() in _LETTERS and len(name) == len("_abs_x"):
            return self.position(_LETTERS.index(name[5:].upper()), span, absolute=True)
        if len(name) == len("_x") and name[1:].upper() in _LETTERS:
            return self.position(_LETTERS.index(name[1:].upper()), span, absolute=False)
        compensated = self._interpreter.compensation
        motion = 80.0 if modal.motion is None else float(modal.motion)
        if modal.motion is None and frame.cycle is not None:
            motion = float(frame.cycle.code[1:])
        feed = 0.0
        if modal.feed is not None:
            speed = modal.feed.speed * 60.0 / length_scale(modal.inch)
            feed = modal.feed.number if modal.inverse_time else speed
        known = {
            "_motion_mode": 10.0 * motion,
            "_plane": 10.0 * (modal.plane or 17),
            "_coord_system": _NAMES_OF_SYSTEMS[frame.system],
            "_metric": float(not modal.inch),
            "_imperial": float(modal.inch),
            "_absolute": float(not modal.incremental),
            "_incremental": float(modal.incremental),
            "_inverse_time": float(modal.inverse_time),
            "_units_per_minute": float(not (modal.inverse_time or modal.per_turn)),
            "_units_per_rev": float(modal.per_turn),
            "_tool_offset": float(frame.tool_length != 0.0),
            "_retract_r_plane": float(not frame.to_initial),
            "_retract_old_z": float(frame.to_initial),
            "_spindle_rpm_mode": float(frame.surface is None),
            "_spindle_css_mode": float(frame.surface is not None),
            "_ijk_absolute_mode": float(modal.absolute_centres),
            "_lathe_diameter_mode": float(modal.diameter),
            "_lathe_radius_mode": float(not modal.diameter),
            "_spindle_on": float(frame.direction != 0),
            "_spindle_cw": float(frame.direction > 0),
            "_feed": feed,
            "_rpm": frame.spindle_rpm,
            "_current_tool": float(frame.changed or 0),
            "_selected_tool": float(frame.tool),
            "_ccomp": {1: 410.0, -1: 420.0}.get(0 if compensated is None else compensated.side, 400.0),
            "_metric_machine": 1.0,
            "_remap_level": 0.0,
            # a check is to compute the same as the run
            "_task": 1.0,
            # version of LinuxCNC, whose language this is
            "_vmajor": 2.9,
            "_vminor": 0.0,
        }
        return known.get(name)

    def _offsets(self, frame: Frame) -> dict[int, Mapping[int, float]]:
        found: dict[int, Mapping[int, float]] = {
            first: frame.stored.get(code, {}) for first, code in _STORED.items()
        }
        found[_G92] = frame.g92
        found[_OFFSETS_OF_TOOL] = {2: frame.tool_length}
        found.update({first: frame.systems.get(number, {}) for first, number in _SYSTEMS.items()})
        return found

    def _offset(self, offsets: Mapping[int, float], letter: int) -> float:
        """Return an offset in the machine's units, as LinuxCNC keeps them [mm or deg]."""
        axis = self._axes[letter]
        return offsets.get(axis, 0.0) / self._scale(axis, inch=False)

    def _scale(self, axis: int, *, inch: bool) -> float:
        found = self._machine.axis(axis)
        return MM if found is None else axis_scale(found.type, inch)

    def position(self, letter: int, span: Span, *, absolute: bool) -> float:
        """Return the position of an axis before the line, in the program's units.

        Args:
            letter: its index in XYZABCUVW. absolute: from the machine's zero, not the program's.

        Raises as `numbered` does.
        """
        axis = self._axes[letter]
        positions = self._interpreter.positions if absolute else self._interpreter.coordinates
        if axis not in positions:
            return 0.0
        own = self._interpreter.axes_of(axis)
        unsynced = frozenset((axis,)) if absolute else self._transformation.coupled(frozenset(own))
        unsynced = frozenset(each for each in unsynced if each in self._interpreter.unsynced)
        if unsynced:
            self._wait(f"where {_LETTERS[letter]} is", span, unsynced)
        modal = self._interpreter.modal
        place = positions[axis]
        if not absolute:
            place = self._programmed(axis, positions, modal.shift or {}, self._transformation, span)
        return place / self._scale(axis, inch=modal.inch)

    @property
    def _transformation(self) -> Transformation:
        return self._interpreter.modal.transformation or Transformation()

    def _programmed(
        self,
        axis: int,
        place: Mapping[int, float],
        zero: Mapping[int, float],
        transformation: Transformation,
        span: Span,
    ) -> float:
        """Return the programmed coordinate of a place [m or rad].

        Raises:
            ComputingError: MC187 codes rotate or scale the axis: controllers differ in what it then reads.
        """
        if axis in transformation.changed or (transformation.tilted and axis in (0, 1, 2)):
            raise ComputingError(
                "MC187",
                "positions under G68, G51, G16 and G68.2 differ from controller to controller",
                span,
                "read them ahead of these codes or behind G69, G50 and G15; #<_abs_x> is of the machine",
            )
        reads = {each: at - zero.get(each, 0.0) for each, at in place.items()}
        return back(transformation.directions, reads)[axis]

    def _probed(self, number: int, span: Span) -> float:
        probe = self._probe
        if probe is None:
            return 0.0
        if probe.place is None:
            self._wait("what a probe met", span)
            return 0.0
        if self._source is Source.ASSUMED:
            self._assume("each probe meets the work where its move ends")
        if number == _DIGITIZED:
            return float(probe.tripped)
        axis = self._axes[number - _PROBE]
        if axis not in probe.place:
            return 0.0
        place = self._programmed(axis, probe.place, probe.shift, probe.transformation, span)
        return place / self._scale(axis, inch=probe.inch)

    def _read(self, span: Span) -> float:
        if self._input is None:
            self._wait("what an input was", span)
            return 0.0
        if self._source is Source.ASSUMED:
            self._assume("each input is as M66 waits for it, with L0 as it is at the start")
        return self._input

    def _wait(self, what: str, span: Span, axes: frozenset[int] = frozenset()) -> None:
        if self._source is Source.MACHINE:
            raise Unsettled(axes)
        if self._source is Source.NOWHERE:
            raise ComputingError(
                "MC168",
                f"{what} was measured as the program ran, and is not known",
                span,
                "start at a line before it is measured",
            )
