"""The modal state of a program (D-10 to D-15), an immutable value."""

from __future__ import annotations

import msgspec

from mcserver.gcode.computing.parameters import ComputedState
from mcserver.gcode.profiles.codes import LEAST_FEED_UNDER_G99
from mcserver.gcode.profiles.frame import Frame
from mcserver.gcode.profiles.transformation import Transformation
from mcserver.gcode.semantics.program_units import length_scale, path_speed
from mcserver.machine.clearance_section import GivenBody
from mcserver.machine.machine_file import Machine
from mcserver.units import MM


class Feed(msgspec.Struct, frozen=True, gc=False):
    """F in force.

    Attributes:
        number: as written; degrees per minute for a rotary move, moves per minute under G93.
        speed: along a path under G94 [m/s], in the units in force where F was written (D-11); 0 under G93.
            Under G95 both are for one revolution per minute.
    """

    number: float
    speed: float


class SplineEnd(msgspec.Struct, frozen=True):
    """End of the last G5, and the vector from its last control point to that end, X and Y [m]."""

    place: tuple[float, ...]
    leaving: tuple[float, ...]


class ControlPoints(msgspec.Struct, frozen=True):
    """A curve under construction, from G5.2 to G5.3.

    Attributes:
        line: of G5.2. order: one more than its degree. points: X and Y along the axes [m] and weight.
    """

    line: int
    order: int
    points: tuple[tuple[float, float, float], ...]


class ModalState(msgspec.Struct, frozen=True):
    """State that stays in force from line to line; the defaults are a program's start (D-10).

    Attributes:
        inch: G20. incremental: G91. inverse_time: G93. per_turn: G95. exact_stop: G61.
        exact_next: G09 for the next motion command.
        tolerance: P of G64 [m]; None: the machine file's.
        tool: number of the tool in force, None after G1050.
        feed: None without an F in force.
        plane: 17, 18 or 19 once chosen.
        motion: 0-3, the code that axis words without a code repeat.
        frame: work offsets and spindle of the profiles (D-62); None in the reference's dialect.
        shift: the program's zero in axis positions, axis → [m or rad], from the frame; None: no shift.
        transformation: rotation, scaling and polar coordinates of programmed places (D-94 to D-96).
        absolute_centres: I J K of arcs are positions (G90.1), not relative to the start.
        diameter: X is a diameter (G7).
        spline_end: of the last G5, which a G5 without I and J continues.
        control_points: of a curve that G5.3 has not closed yet.
        relative: axes whose words are increments under G90 too (M83).
        flow: factor of a printer's E (M221). pace: factor of F (M220); kept_pace: the one that M220 R
            restores (D-141).
        advance: K of pressure advance [s] (D-143); None: the machine file's.
        coupled: axes that follow others (G1060), each with the line of its G1060.
        computed: parameters and subprograms of the lines before, for a program that starts in its middle.
        bodies: added by the program so far (D-131).
        rollover: absolute words move axes with `Axis.rollover` within one turn (D-139).
        carried: tools selected so far, each once, the last one last: their payloads stay after G1050 (D-55).
    """

    inch: bool = False
    incremental: bool = False
    inverse_time: bool = False
    per_turn: bool = False
    exact_stop: bool = False
    exact_next: bool = False
    tolerance: float | None = None
    tool: int | None = None
    feed: Feed | None = None
    plane: int | None = None
    motion: int | None = None
    frame: Frame | None = None
    shift: dict[int, float] | None = None
    transformation: Transformation | None = None
    absolute_centres: bool = False
    diameter: bool = False
    spline_end: SplineEnd | None = None
    control_points: ControlPoints | None = None
    relative: tuple[int, ...] = ()
    flow: float = 1.0
    pace: float = 1.0
    kept_pace: float = 1.0
    advance: float | None = None
    carried: tuple[int, ...] = ()
    coupled: tuple[tuple[int, int], ...] = ()
    bodies: tuple[GivenBody, ...] = ()
    rollover: bool = False
    computed: ComputedState | None = None

    @property
    def builds_on_places(self) -> bool:
        """Whether ends of moves depend on present positions: increments, or axes coupled by a rotation."""
        return self.incremental or self.transformation is not None


INITIAL = ModalState()
PRINTER_FEED = 1500.0  # mm/min
SMALLEST_FEED = 1e-6


def with_frame(modal: ModalState, frame: Frame) -> ModalState:
    """Return the state with another frame, and its zero and directions."""
    found = msgspec.structs.replace(
        modal.transformation or Transformation(),
        directions=frame.directions,
        tilted=frame.plane is not None,
    )
    return msgspec.structs.replace(
        modal, frame=frame, shift=frame.shift(), transformation=None if found.idle else found
    )


def initial_modal(machine: Machine, frame: Frame | None = None) -> ModalState:
    """Return the state at a program's start (D-10); cnc and printer start in G17 (D-61, D-66)."""
    profile = machine.dialect.profile
    start = INITIAL if profile in ("reference", "robot") else ModalState(plane=17)
    if profile == "printer":
        # slicers omit F in the first moves: Marlin and Klipper start with 25 mm/s
        start = ModalState(plane=17, feed=Feed(PRINTER_FEED, path_speed(PRINTER_FEED, inch=False)))
    if profile == "cnc" and any(axis.rollover is not None for axis in machine.axes):
        start = msgspec.structs.replace(start, rollover=True)
    if frame is None and machine.dialect.systems:
        frame = Frame(systems=machine.dialect.systems)
    if frame is None or profile not in ("cnc", "robot"):
        return start
    return with_frame(start, msgspec.structs.replace(frame, tip_tool=None, by_direction=False, plane=None))


def with_tables(modal: ModalState, machine: Machine, frame: Frame) -> ModalState:
    """Return the state with the work coordinate systems and tools of ``frame``."""
    start = initial_modal(machine, frame).frame
    if start is None:
        return modal
    before = modal.frame or start
    plane = before.plane
    if plane is not None and before.systems.get(before.system) != frame.systems.get(before.system):
        # another G53.1 is needed
        plane = msgspec.structs.replace(plane, facing=None)
    kept = msgspec.structs.replace(
        before, systems=frame.systems, cutters=frame.cutters, worn=frame.worn, plane=plane
    )
    return with_frame(modal, kept)


def smallest_feed(modal: ModalState) -> float:
    """Return the least F that is accepted, as written.

    Under G99 without a canned cycle, an F of a few hundredths is one per revolution, in a program for a
    lathe.
    """
    frame = modal.frame
    turning = frame is not None and not frame.to_initial and frame.cycle is None
    if not turning or modal.inverse_time or modal.per_turn:
        return SMALLEST_FEED
    return LEAST_FEED_UNDER_G99 * MM / length_scale(modal.inch)


def read_feed(number: float, modal: ModalState) -> Feed:
    """Convert F from the units in force at its place (D-11)."""
    return Feed(number, 0.0 if modal.inverse_time else path_speed(number, modal.inch))


def apply_setting(code: int, modal: ModalState, tolerance: float | None = None) -> ModalState:
    """Return the state after a modal code.

    Args:
        code: number of a code of kind SETTING.
        tolerance: P of G64 in program units, or None.
    """
    match code:
        case 9:
            return msgspec.structs.replace(modal, exact_next=True)
        case 17 | 18 | 19:
            return msgspec.structs.replace(modal, plane=code)
        case 20 | 21:
            return msgspec.structs.replace(modal, inch=code == 20)
        case 61:
            return msgspec.structs.replace(modal, exact_stop=True)
        case 64:
            kept = None if tolerance is None else tolerance * length_scale(modal.inch)
            return msgspec.structs.replace(modal, exact_stop=False, tolerance=kept)
        case 90 | 91:
            return msgspec.structs.replace(modal, incremental=code == 91)
        case 93 | 94 | 95:
            inverse, per_turn = code == 93, code == 95
            if inverse == modal.inverse_time and per_turn == modal.per_turn:
                return modal
            return msgspec.structs.replace(modal, inverse_time=inverse, per_turn=per_turn, feed=None)  # D-12
        case 1050:
            return msgspec.structs.replace(modal, tool=None)
    raise ValueError(f"G{code} is not a modal code")
