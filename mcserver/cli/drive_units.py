"""``mcserver drives units``: the scale of an axis, from its drive's objects and from a measured move."""

from __future__ import annotations

from typing import Annotated

import msgspec
import typer

from mcserver.can.open import open_port
from mcserver.canopen.bus_frames import frames_of
from mcserver.canopen.cycle_samples import POSITION
from mcserver.canopen.desk import LEAST_LISTEN_S
from mcserver.canopen.listening import for_masters, sign_of_master
from mcserver.canopen.units_check import (
    corrected_lines,
    counted,
    measured_scale,
    proposed_lines,
    scale_of,
)
from mcserver.cli.console import json_answer_on_error, narration, results, write_json, write_text
from mcserver.cli.drive_of_machine import AxisArgument, Described, at_desk_of, described, table
from mcserver.cli.exit_codes import ExitCode
from mcserver.cli.options import JsonOption, MachineOption
from mcserver.drives.cia402.drive import cia402_drive
from mcserver.errors import RuntimeFault, UsageFault

# A position comes with every cycle of a server.
READING_S = 1.0


def units(
    axis: AxisArgument,
    machine: MachineOption,
    pitch: Annotated[
        float | None, typer.Option("--pitch", help="mm or degrees of the axis for a turn of the gear.")
    ] = None,
    check: Annotated[
        bool, typer.Option("--check", help="Measure a small move: ask before it and after it.")
    ] = False,
    json: JsonOption = False,
) -> None:
    """Show the drive's scale beside the machine file's; --check proves it by a small measured move."""
    with json_answer_on_error(json):
        if pitch is not None and not 0.0 < pitch < float("inf"):
            raise UsageFault("MC017", f"--pitch {pitch:g} is no pitch", "give mm or degrees above 0")
        drive = described(machine, axis)
        master = _master_of(drive)
        if check:
            _check(drive, master, json)
        elif master:
            raise RuntimeFault(
                "MC560",
                f"{drive.settings.name}: {master} heard: another master is at work, the drive is not asked",
                "stop it first; --check works beside a running server",
                axis=axis,
            )
        else:
            _compare(drive, pitch, json)


def _compare(drive: Described, pitch: float | None, json: bool) -> None:
    with at_desk_of(drive.settings) as desk:
        scale = scale_of(desk)
    own, file = cia402_drive(drive.axis), []
    for name, index, held, wanted in (
        ("encoder [increments, motor turns]", "608Fh", scale.encoder, own.encoder),
        ("gear [motor turns, shaft turns]", "6091h", scale.gear, own.gear),
        ("feed [position units, shaft turns]", "6092h", scale.feed, _written(drive, 0x6092)),
    ):
        file.append((index, name, _ratio(held), _ratio(wanted)))
    lines = proposed_lines(scale, pitch)
    if json:
        write_json({"ok": True, "drive": scale, "lines": lines})
        return
    results().print(table(("object", "what", "drive", "machine file writes"), file))
    write_text("".join(f"{line}\n" for line in lines))
    unit, turn = drive.axis.type.unit, drive.axis.travel_per_motor_turn / drive.axis.type.si_per_unit
    narration().print(f"the machine file: {turn:g} {unit} a turn of the motor; --check proves it by a move")


def _check(drive: Described, master: str, json: bool) -> None:
    """Read the position, let the axis be moved, read it again, and compare with what was measured."""
    unit = drive.axis.type.unit
    encoder = cia402_drive(drive.axis).encoder
    assert encoder is not None
    per_turn = encoder[0] / encoder[1]
    if not master:
        # before the first boot-up the drive may count in units of its own
        with at_desk_of(drive.settings) as desk:
            per_turn = scale_of(desk).units_per_motor_turn or per_turn
    before = _position(drive, master)
    how = "by `mcctl jog`, within its limits" if master else "by hand: no server runs"
    narration().print(
        f"axis {drive.settings.axis} stands at count {before}. Move it {how}, and let it stand."
    )
    try:
        # what is no number is asked for again: the axis has moved already
        moved = float(typer.prompt(f"how far did it go, with its sign [{unit}]", type=float, err=True))
    except typer.Abort as error:
        raise UsageFault("MC017", "no length was given", f"give {unit}, such as 10 or -10") from error
    counts = counted(before, _position(drive, master))
    found = measured_scale(drive.axis, counts, per_turn, moved)
    lines = corrected_lines(drive.axis, found)
    if json:
        answer = {"ok": True, "fits": found.fits, "counts": counts, "measured": moved, "lines": lines}
        write_json({**answer, **msgspec.to_builtins(found)})
    else:
        results().print(
            f"{counts:.0f} counts, {found.motor_turns:.4f} turns of the motor: {found.shown:.4f} {unit} by "
            f"the machine file, {moved:g} {unit} measured"
        )
        write_text("".join(f"{line}\n" for line in lines))
    narration().print(
        "the machine file fits" if found.fits else "the machine file does not fit: change it so"
    )
    if not found.fits:
        raise typer.Exit(int(ExitCode.CONFIGURATION))


def _master_of(drive: Described) -> str:
    """By what another master is noticed on a drive's bus; empty: none is heard."""
    if drive.settings.fieldbus == "ethercat":
        # its desk refuses to come beside one
        return ""
    port = open_port(drive.settings.address)
    try:
        bus = for_masters(drive.settings, port)
        heard = frames_of(port, max(LEAST_LISTEN_S, drive.settings.listen_s))
        return next(filter(None, (sign_of_master(identifier, bus) for _, identifier, _ in heard)), "")
    finally:
        port.close()


def _position(drive: Described, master: str) -> int:
    """6064h: from process data beside a master, else by SDO."""
    settings = drive.settings
    if not master:
        with at_desk_of(settings) as desk:
            found = desk.read_number(POSITION[0] + settings.offset)
        if found is None:
            raise RuntimeFault(
                "MC569", f"{settings.name}: 6064h cannot be read", "see its EDS", axis=settings.axis
            )
        return found - (found >> 31 << 32)
    sources = {
        cob_id: (signal, at)
        for signal in drive.signals
        if signal.place == POSITION
        for cob_id, at in signal.sources
    }
    latest: int | None = None
    port = open_port(settings.address)
    try:
        for _, identifier, payload in frames_of(port, READING_S):
            if identifier in sources:
                signal, at = sources[identifier]
                if len(payload) >= at + signal.packing.size:
                    latest = signal.packing.unpack_from(payload, at)[0]
    finally:
        port.close()
    if latest is None:
        raise RuntimeFault(
            "MC569",
            f"{settings.name}: no position (6064h) came on the bus within {READING_S:g} s",
            "see `mcctl drives`, and that the server runs with this machine file",
            axis=settings.axis,
        )
    return latest


def _written(drive: Described, index: int) -> tuple[int, int] | None:
    found = [value for each, _, value in drive.settings.scaling if each == index]
    return (found[0], found[1]) if len(found) == 2 else None


def _ratio(ratio: tuple[int, int] | None) -> str:
    return "–" if ratio is None else f"{ratio[0]}, {ratio[1]}"
