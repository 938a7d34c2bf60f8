"""Parameters of a drive taken into a file and brought back, verified."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from mcserver.canopen.canopen_errors import DriveError
from mcserver.canopen.desk import Desk
from mcserver.canopen.parameter_file import (
    DriveIdentity,
    ParameterFile,
    Place,
    differing,
    in_drive,
    is_stored,
    stored,
)
from mcserver.canopen.parameters import Parameter, encode
from mcserver.errors import UsageFault

IDENTITY = 0x1018
# Parameters that bound each other are taken in the next pass, once the others hold.
PASSES = 3
SHOWN = 8
# A parameter that was written, the value before and the value now.
OnWrite = Callable[[Parameter, object, object], None]


def identity_of(desk: Desk, eds_sha256: str = "") -> DriveIdentity:
    """Ask a drive for 1018h; ``eds_sha256``: of its EDS.

    Raises:
        DriveError: MC554. RuntimeFault: MC560.
    """
    vendor, product, revision, serial = (desk.read_number(IDENTITY, subindex) for subindex in (1, 2, 3, 4))
    return DriveIdentity(vendor, product, revision, serial, eds_sha256)


def take_backup(
    desk: Desk, parameters: Sequence[Parameter], taken: str = "", eds_sha256: str = ""
) -> ParameterFile:
    """Read every parameter that a drive keeps; those that it refuses are named in `unread`.

    Args:
        taken: when, ISO 8601. eds_sha256: of the drive's EDS.

    Raises:
        DriveError: MC554. RuntimeFault: MC560.
    """
    identity = identity_of(desk, eds_sha256)
    found, unread = [], []
    for each in parameters:
        if not is_stored(each):
            continue
        try:
            reading = desk.read(each)
        except DriveError as error:
            if error.code != "MC553":
                raise
            unread.append(error.message)
            continue
        if reading.kind == each.type:
            found.append(stored(each, reading.kind, reading.value))
        else:
            unread.append(f"{each.title} has {len(reading.raw)} bytes, which is no {each.type} of the EDS")
    return ParameterFile(identity, found, taken, unread)


def _broken_off(error: DriveError, written: int, wanted: int) -> DriveError:
    """Say how far a restore came whose drive was lost."""
    return DriveError(
        error.code,
        f"{error.message}; {written} of {wanted} parameters that differ were written before it, "
        "none is stored",
        f"{error.hint}; then restore again: it writes what still differs",
        axis=error.axis,
        **error.details,
    )


def restore(
    desk: Desk, parameters: Sequence[Parameter], file: ParameterFile, on_write: OnWrite
) -> list[Parameter]:
    """Write what differs into a drive without energy, read all back, and return what was written.

    Nothing is written before identity, names, types and limits of the whole file have been found to fit.

    Raises:
        UsageFault: MC565 the file has what is no parameter of the drive, MC559 a value that the EDS does not
            allow, MC566 another device.
        DriveError: MC567 the drive did not take everything; MC553, MC554, MC559. RuntimeFault: MC560.
    """
    known = {each.place: each for each in parameters if is_stored(each)}
    wanted = {place: known.get(in_drive(place, desk.drive.node_axis)) for place in file.values}
    for place, value in file.values.items():
        parameter = wanted[place]
        if parameter is None or parameter.type != value.type:
            why = "is no parameter that is kept" if parameter is None else f"is {parameter.type} here"
            raise UsageFault(
                "MC565",
                f"{value.object} {value.name} ({value.type}) {why}, by the drive's EDS",
                "give the EDS with which it was taken, or take the line out",
            )
        encode(parameter, value.value)
    reason = file.drive.difference(identity_of(desk))
    if reason:
        raise UsageFault(
            "MC566", f"{desk.drive.name}: the parameters are of another device: {reason}", "give its own file"
        )
    desk.refuse_energized()
    own = [each for each in wanted.values() if each is not None]
    held = take_backup(desk, own)
    left = differing(file.values, held.values)
    written: dict[Place, Parameter] = {}
    refused: dict[Place, str] = {}
    for _ in range(PASSES):
        before, refused = len(left), {}
        for place in left:
            changed, target = wanted[place], file.values[place].value
            assert changed is not None
            try:
                desk.write(changed, target)
            except DriveError as error:
                if error.code not in ("MC553", "MC559"):
                    raise _broken_off(error, len(written), len(left)) from None
                refused[place] = error.message
                continue
            written[place] = changed
            was = held.values.get(place)
            on_write(changed, None if was is None else was.value, target)
        left = list(refused)
        if not left or len(left) == before:
            break
    now = take_backup(desk, own)
    wrong = differing(file.values, now.values)
    if wrong:
        said = [refused.get(place, f"{file.values[place].object} holds another value") for place in wrong]
        raise DriveError(
            "MC567",
            f"{desk.drive.name}: {len(wrong)} of {len(file.parameters)} parameters were not taken: "
            + "; ".join(said[:SHOWN])
            + (f"; and {len(said) - SHOWN} more" if len(said) > SHOWN else ""),
            "the others hold, nothing is stored: correct these lines, or take them out, and restore again",
            axis=desk.drive.axis,
        )
    return list(written.values())
