"""Files that commands write: refused early where they cannot be, and whole or not at all."""

from __future__ import annotations

import importlib.util
import os
import stat
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO, TypeVar

from mcserver.cli.exit_codes import OutputFault
from mcserver.errors import ConfigurationError, UsageFault

T = TypeVar("T")


def check_output(path: str, suffixes: tuple[str, ...]) -> str:
    """Return the suffix of ``path``, in lower case, once it is known that a file can be written there.

    Raises:
        UsageFault: MC012 another suffix, MC013 a folder, or one that is missing or not writable.
        ConfigurationError: MC016 it is a picture, and the package that draws it is missing.
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
        # a device is written itself, a file by a new one beside it
        place, right = (real, os.W_OK) if _is_special(real) else (folder, os.W_OK | os.X_OK)
        writable = os.access(place, right)
    except ValueError as error:
        raise UsageFault("MC013", f"{path!r} is not a file name: {error}", "give another name") from error
    if not writable:
        raise UsageFault("MC013", f"{path} cannot be written: permission denied", "choose another folder")
    if suffix == ".png" and importlib.util.find_spec("matplotlib") is None:
        remedy = "pip install 'mcserver[plot]'"
        remedy += "; an .html page needs nothing more" if ".html" in suffixes else ""
        raise ConfigurationError("MC016", "pictures need matplotlib", remedy)
    return suffix


def write_atomically(path: str, write: Callable[[BinaryIO], T]) -> T:
    """Write a file whole or not at all: a temporary file beside it, then a rename.

    A symbolic link stays one; a device or a pipe is written directly. Returns what ``write`` does.

    Raises:
        OutputFault: MC014 the disk is full or refuses; what was there before stays.
    """
    real = os.path.realpath(path)
    try:
        if _is_special(real):
            with open(real, "wb") as stream:
                return write(stream)
        temporary = f"{real}.{os.getpid()}.part"
        try:
            with open(temporary, "xb") as stream:
                found = write(stream)
                stream.flush()
                os.fsync(stream.fileno())
            if os.path.exists(real):
                os.chmod(temporary, stat.S_IMODE(os.stat(real).st_mode))
            os.replace(temporary, real)
            return found
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
    """Return whether a device, a pipe or a socket is there."""
    return os.path.exists(real) and not os.path.isfile(real)
