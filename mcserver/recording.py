"""What a run did, one row a cycle, and its files: CSV and NPZ (interfaces: ``--output``)."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO, Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from mcserver.commands.faults import OutputFault, UsageFault

Array = NDArray[np.float64]

_ROWS_AT_ONCE = 4096


class Recording(Protocol):
    """Columns of a run over K axes and N cycles, in mm and degrees.

    Attributes:
        time_s: shape (N,), uniform [s].
        line: shape (N,), the line that set the row, 0 where none runs.
        axes: shape (K,), axis numbers.
        setpoint, actual: shape (N, K) [mm, deg].
    """

    @property
    def time_s(self) -> Array: ...
    @property
    def line(self) -> Array: ...
    @property
    def axes(self) -> Array: ...
    @property
    def setpoint(self) -> Array: ...
    @property
    def actual(self) -> Array: ...


def write_csv(recording: Recording, stream: BinaryIO) -> None:
    """Header ``time_s,line,setpoint_0,actual_0,…`` and one row a cycle; numbers read back exactly.

    msgspec writes the shortest decimal that gives the same double, some ten times as fast as formatting
    by ``%``: the rows are encoded as JSON arrays and the brackets taken off.
    """
    names = ["time_s", "line"]
    for axis in recording.axes:
        names += [f"setpoint_{int(axis)}", f"actual_{int(axis)}"]
    stream.write(",".join(names).encode() + b"\n")
    count = len(recording.time_s)
    interleaved = np.empty((count, 2 * len(recording.axes)))
    interleaved[:, 0::2] = recording.setpoint
    interleaved[:, 1::2] = recording.actual
    line = recording.line.astype(np.int64)
    encoder = msgspec.json.Encoder()
    for first in range(0, count, _ROWS_AT_ONCE):
        part = slice(first, first + _ROWS_AT_ONCE)
        columns = [recording.time_s[part].tolist(), line[part].tolist()]
        columns += [column.tolist() for column in interleaved[part].T]
        rows = encoder.encode(list(zip(*columns, strict=True)))
        stream.write(rows[2:-2].replace(b"],[", b"\n").replace(b"null", b"nan") + b"\n")


def write_npz(recording: Recording, stream: BinaryIO) -> None:
    """Arrays ``time_s``, ``line``, ``axes``, ``setpoint``, ``actual``, all float64."""
    np.savez(
        stream,
        time_s=np.asarray(recording.time_s, dtype=np.float64),
        line=np.asarray(recording.line, dtype=np.float64),
        axes=np.asarray(recording.axes, dtype=np.float64),
        setpoint=np.asarray(recording.setpoint, dtype=np.float64),
        actual=np.asarray(recording.actual, dtype=np.float64),
    )


def check_output(path: str, suffixes: tuple[str, ...]) -> str:
    """The suffix of ``path``, in lower case, once it is known that a file can be written there.

    Raises:
        UsageFault: MC012 another suffix, MC013 a folder, or one that is missing or not writable.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in suffixes:
        named = f"ends in {suffix!r}" if suffix else "has no suffix"
        raise UsageFault(
            "MC012", f"the output {path} {named}", f"give a name that ends in {' or '.join(suffixes)}"
        )
    try:
        real = os.path.realpath(path)
        folder = os.path.dirname(real)
        if not os.path.isdir(folder):
            raise UsageFault("MC013", f"there is no folder {folder}", f"make it first: mkdir -p {folder}")
        if os.path.isdir(real):
            raise UsageFault("MC013", f"{path} is a folder", "name a file in it")
        if _is_special(real):
            writable = os.access(real, os.W_OK)
        else:
            writable = os.access(folder, os.W_OK | os.X_OK)
    except ValueError as error:
        raise UsageFault("MC013", f"{path!r} is not a file name: {error}", "give another name") from error
    if not writable:
        raise UsageFault("MC013", f"{path} cannot be written: permission denied", "choose another folder")
    return suffix


def write_atomically(path: str, write: Callable[[BinaryIO], None]) -> None:
    """Write a file whole or not at all: a temporary file beside it, then a rename.

    A symbolic link stays one; a device or a pipe is written directly.

    Raises:
        OutputFault: MC014 the disk is full or refuses; what was there before stays.
    """
    real = os.path.realpath(path)
    try:
        if _is_special(real):
            with open(real, "wb") as stream:
                write(stream)
            return
        temporary = f"{real}.{os.getpid()}.part"
        try:
            with open(temporary, "xb") as stream:
                write(stream)
                stream.flush()
                os.fsync(stream.fileno())
            if os.path.exists(real):
                os.chmod(temporary, stat.S_IMODE(os.stat(real).st_mode))
            os.replace(temporary, real)
        except BaseException:
            if os.path.exists(temporary):
                os.unlink(temporary)
            raise
    except OSError as error:
        raise OutputFault(
            "MC014",
            f"{path} could not be written: {error.strerror or error}",
            "make room on the disk, or choose another place",
        ) from error


def _is_special(real: str) -> bool:
    """Whether a device, a pipe or a socket is there."""
    return os.path.exists(real) and not os.path.isfile(real)
