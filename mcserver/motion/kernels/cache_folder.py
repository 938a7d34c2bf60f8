"""The cache folder of compiled kernels: one for each user, shared by all installations."""

from __future__ import annotations

import contextlib
import hashlib
import os
import stat
import sys
import tempfile
import time
from pathlib import Path

# First bytes of each file; the number is that of the format.
_MAGIC = b"mckernel1\n"
_DIGEST = hashlib.sha256().digest_size
# Files that have not been read for this time are removed [s].
_KEPT_S = 60 * 86400.0
# A read is noted in the file's time once in this time [s].
_NOTED_S = 86400.0


def cache_folder() -> Path | None:
    """Return the folder, made if need be; None where it cannot be made, or others may write to it.

    It is ``$NUMBA_CACHE_DIR/mcserver-kernels``, or ``mcserver/kernels`` in the user's cache folder. Its
    content runs as machine code, so it has to belong to the user that runs it.
    """
    folder = _place()
    if folder is None:
        return None
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        state = folder.stat()
    except OSError:
        return None
    if sys.platform != "win32":
        if state.st_uid != os.geteuid() or state.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
            return None
    return folder


def _place() -> Path | None:
    given = os.environ.get("NUMBA_CACHE_DIR")
    if given:
        return Path(given) / "mcserver-kernels"
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA", "")
    elif sys.platform == "darwin":
        base = os.path.expanduser("~/Library/Caches")
    else:
        base = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    return Path(base) / "mcserver" / "kernels" if os.path.isabs(base) else None


def read(name: str) -> bytes | None:
    """Return what was stored under a name; None where there is nothing, or an incomplete file."""
    folder = cache_folder()
    if folder is None:
        return None
    path = folder / name
    try:
        content = path.read_bytes()
        if time.time() - path.stat().st_mtime > _NOTED_S:
            os.utime(path)
    except OSError:
        return None
    head, payload = content[: len(_MAGIC) + _DIGEST], content[len(_MAGIC) + _DIGEST :]
    if head != _MAGIC + hashlib.sha256(payload).digest():
        return None
    return payload


def write(name: str, payload: bytes) -> bool:
    """Store a payload under a name atomically; return whether it was stored.

    Several processes may write the same name: the last complete file stays.
    """
    folder = cache_folder()
    if folder is None:
        return False
    temporary: str | None = None
    try:
        with tempfile.NamedTemporaryFile(dir=folder, prefix="new-", delete=False) as file:
            temporary = file.name
            file.write(_MAGIC + hashlib.sha256(payload).digest() + payload)
        os.replace(temporary, folder / name)
    except OSError:
        # read-only or full: the next process has to compile again
        if temporary is not None:
            with contextlib.suppress(OSError):
                os.unlink(temporary)
        return False
    return True


def remove_unused() -> None:
    """Remove files that have not been read for two months, such as those of old releases."""
    folder = cache_folder()
    if folder is None:
        return
    oldest = time.time() - _KEPT_S
    with contextlib.suppress(OSError):
        for path in folder.iterdir():
            with contextlib.suppress(OSError):
                if path.stat().st_mtime < oldest:
                    path.unlink()
