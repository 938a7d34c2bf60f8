"""Save a program's modal state at M70 and M73, and write the codes that restore it (D-138)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mcserver.gcode.computing.expressions import ComputingError
from mcserver.gcode.line_faults import Span
from mcserver.gcode.profiles.frame import Frame
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.gcode.semantics.modal import ModalState
from mcserver.gcode.semantics.program_units import length_scale
from mcserver.machine.work_systems import SYSTEM_NUMBERS

_SYSTEMS = {number: code for code, number in SYSTEM_NUMBERS.items()}
_SPINDLE = {1: "M3", -1: "M4", 0: "M5"}


class SavedState(NamedTuple):
    """A saved state: a code per modal group, and state that codes of one line cannot restore."""

    codes: tuple[str, ...]
    lasting: tuple[object, ...]


def state_of(interpreter: Interpreter, span: Span) -> SavedState:
    """Return the current state.

    Raises:
        ComputingError: MC208 the machine has outputs that a saved state does not include.
    """
    outputs = sorted({"M7", "M8", "M9"} & interpreter.machine.dialect.outputs.keys())
    if outputs:
        shown = f"what {' and '.join(outputs)} switched is not saved on this machine"
        raise ComputingError("MC208", shown, span, "write the codes that are to be in force afterwards")
    modal, compensation = interpreter.modal, interpreter.compensation
    frame = modal.frame or Frame()
    side = 0 if compensation is None else compensation.side
    tip = None if frame.tip_tool is None else frame.tip_code
    lasting = (modal.transformation, modal.control_points, modal.per_turn, frame.plane, tip)
    return SavedState(_codes(modal, frame), (*lasting, frame.surface, side))


def restoring_line(saved: SavedState, interpreter: Interpreter, span: Span) -> str:
    """Return the line of codes that restores a state; empty if it is in force.

    Raises:
        ComputingError: MC208 state differs that codes of one line cannot restore.
    """
    now = state_of(interpreter, span)
    if now.lasting != saved.lasting:
        raise ComputingError(
            "MC208",
            "G41, G43.4, G43.5, G95, G96, turned, scaled, polar and tilted coordinates are not brought back",
            span,
            "end what has begun since the state was saved, such as by G40, G94 or G69",
        )
    return " ".join(code for code, other in zip(saved.codes, now.codes, strict=True) if code != other)


def _codes(modal: ModalState, frame: Frame) -> tuple[str, ...]:
    unit = length_scale(modal.inch)
    modes = ("G94", "G93") if modal.inverse_time else ("G93", "G94")
    # a change of the mode forgets F (D-12)
    feed = " ".join(modes)
    if modal.feed is not None:
        number = modal.feed.number if modal.inverse_time else 60.0 * modal.feed.speed / unit
        feed = f"{modes[1]} F{_shown(number)}"
    rounding = "G64" if modal.tolerance is None else f"G64 P{_shown(modal.tolerance / unit)}"
    length = frame.tool_length
    return (
        "G20" if modal.inch else "G21",
        "G91" if modal.incremental else "G90",
        "G90.1" if modal.absolute_centres else "G91.1",
        feed,
        "G61" if modal.exact_stop else rounding,
        f"G{modal.plane or 17}",
        "G7" if modal.diameter else "G8",
        _SYSTEMS[frame.system],
        "G98" if frame.to_initial else "G99",
        f"G43.1 Z{_shown(length / unit)}" if length else "G49",
        f"S{_shown(frame.spindle_rpm)} {_SPINDLE[frame.direction]}",
    )


def _shown(number: float) -> str:
    return np.format_float_positional(number, trim="-")
