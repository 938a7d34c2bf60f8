"""Inputs and outputs in a program: M62 to M68, and codes mapped to outputs (D-70 to D-73)."""

from __future__ import annotations

from typing import Final

from mcserver.gcode.semantics.block_state import BlockState
from mcserver.gcode.text.profile_words import Action, ProfileWord
from mcserver.machine.io_section import MAX_CHANNELS, Input, Output, find_channel
from mcserver.machine.machine_file import Machine
from mcserver.motion.canonical import InputLine, OutputLine, OutputSetting, WaitMode

# The longest that M66 may wait [s].
LONGEST_WAIT = 86_400.0

# outputs that change with the next motion
WITH_MOTION: Final = frozenset({"M62", "M63", "M67"})


def read_io(block: BlockState, action: Action) -> InputLine | OutputLine | None:
    """Return the effect of one of M62 to M68; None after a fault, which is reported."""
    if action.code == "M66":
        return _wait(block, action)
    digital = action.code not in ("M67", "M68")
    column = _column(block, action, "P" if digital else "E", block.setup.machine.outputs, digital=digital)
    if digital:
        value: float | None = float(action.code in ("M62", "M64"))
    else:
        value = _analog_value(block, action, column)
    if column is None or value is None:
        return None
    return OutputLine(
        block.parsed.number, (OutputSetting(column, value),), with_motion=action.code in WITH_MOTION
    )


def read_mapped(
    block: BlockState, code: str, action: Action, speed: float | None, *, only_speed: bool = False
) -> list[OutputLine]:
    """Return what a code sets on the outputs mapped to it in ``[dialect.outputs]``: lasers keep to the path.

    Args:
        code: whose mapping is used. action: for the columns of faults.
        speed: value of the S in force; None: none. A fan's M106 then means full speed; for others it is a
            fault: a heater must not go to its maximum.
        only_speed: only outputs that follow S.
    """
    machine = block.setup.machine
    found: dict[bool, list[OutputSetting]] = {False: [], True: []}
    for each in machine.dialect.outputs.get(code, ()):
        output = machine.outputs[each.column]
        value = each.value
        if value is not None and only_speed:
            continue
        if value is None:
            if speed is None and code != "M106":
                _refuse_missing(block, action, "S", "S0")
                continue
            value = output.high if speed is None else speed
            if not output.low <= value <= output.high:
                _refuse_value(block, action.words.get("S"), action, output, value)
                continue
        scaled = is_scaled(output, code)
        if scaled and value > 0.0 and machine.tools:
            block.faults.add(
                "MC159",
                f'M4 scales "{output.name}" by the speed of axes, which is not that of a tool',
                action.span,
                "use M3 on this machine: its power is the same at any speed",
            )
        # a code that waits does so after it has set the output
        keeps = output.laser or (code not in machine.dialect.waits and keeps_to_path(machine, output))
        found[keeps].append(OutputSetting(each.column, value, scaled))
    return [
        OutputLine(block.parsed.number, tuple(settings), with_motion=with_motion)
        for with_motion, settings in found.items()
        if settings
    ]


def is_scaled(output: Output, code: str) -> bool:
    """Return whether a spindle code scales an output's value with the speed (D-77)."""
    return output.laser and not output.digital and code == "M4"


def keeps_to_path(machine: Machine, output: Output) -> bool:
    """Return whether codes set an output with the next motion: lasers, and as printers' firmware does."""
    return output.laser or machine.dialect.profile == "printer"


def _column(
    block: BlockState,
    action: Action,
    letter: str,
    channels: tuple[Input, ...] | tuple[Output, ...],
    *,
    digital: bool,
) -> int | None:
    """Return the column of the input or output that a word names; None after a reported fault."""
    kind = "digital" if digital else "analog"
    what = "output" if action.code != "M66" else "input"
    word = action.words.get(letter)
    if word is None:
        block.faults.add(
            "MC118",
            f"{action.code} has no {letter}: it names no {kind} {what}",
            action.span,
            f"add {letter}0",
        )
        return None
    known = [each for each in channels if each.digital is digital]
    whole = word.value == int(word.value) if abs(word.value) < MAX_CHANNELS else False
    column = find_channel(channels, int(word.value), digital=digital) if whole else None
    if column is None:
        names = ", ".join(f"{each.number} ({each.name})" for each in known)
        block.faults.add(
            "MC150",
            f"the machine has no {kind} {what} {word.text}",
            word.span,
            f"it has {names}" if known else f"add an [[{what}]] to the machine file",
        )
    return column


def _analog_value(block: BlockState, action: Action, column: int | None) -> float | None:
    word = action.words.get("Q")
    if word is None:
        _refuse_missing(block, action, "Q", "Q1.5")
        return None
    if column is None:
        return None
    output = block.setup.machine.outputs[column]
    if not output.low <= word.value <= output.high:
        _refuse_value(block, word, action, output, word.value)
        return None
    return word.value


def _refuse_missing(block: BlockState, action: Action, letter: str, example: str) -> None:
    what = f"{action.code} has no {letter}: it gives no value"
    block.faults.add("MC118", what, action.span, f"add {letter}, such as {example}")


def _refuse_value(
    block: BlockState, word: ProfileWord | None, action: Action, output: Output, value: float
) -> None:
    unit = f" {output.unit}" if output.unit else ""
    block.faults.add(
        "MC151",
        f'{value:g}{unit} is outside what the output "{output.name}" can have',
        action.span if word is None else word.span,
        f"give {output.low:g} to {output.high:g}{unit}",
    )


def _wait(block: BlockState, action: Action) -> InputLine | None:
    words = action.words
    if "P" in words and "E" in words:
        block.faults.add(
            "MC152", "M66 names two inputs, by P and by E", words["E"].span, "give P (digital) or E (analog)"
        )
        return None
    digital = "E" not in words
    column = _column(block, action, "P" if digital else "E", block.setup.machine.inputs, digital=digital)
    mode = _mode(block, action, digital=digital)
    if mode is None or column is None:
        return None
    if mode is WaitMode.IMMEDIATE:
        return InputLine(block.parsed.number, column, mode, 0.0)
    word = words.get("Q")
    if word is None or not 0.0 < word.value <= LONGEST_WAIT:
        block.faults.add(
            "MC152",
            f"M66 with L{mode.value} does not say how long it waits at the most",
            action.span if word is None else word.span,
            f"add Q with seconds above 0 and up to {LONGEST_WAIT:g}, such as Q10",
        )
        return None
    return InputLine(block.parsed.number, column, mode, word.value)


def _mode(block: BlockState, action: Action, *, digital: bool) -> WaitMode | None:
    word = action.words.get("L")
    if word is None:
        return WaitMode.IMMEDIATE
    if word.value not in tuple(mode.value for mode in WaitMode):
        block.faults.add(
            "MC152",
            f"L{word.text} is nothing that M66 waits for",
            word.span,
            "L0 does not wait, L1 waits for a rise, L2 for a fall, L3 for on, L4 for off",
        )
        return None
    mode = WaitMode(int(word.value))
    if not digital and mode is not WaitMode.IMMEDIATE:
        block.faults.add(
            "MC152", f"M66 does not wait (L{mode.value}) for an analog input", word.span, "read it with L0"
        )
        return None
    return mode
