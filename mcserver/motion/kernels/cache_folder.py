"""The folder of compiled kernels: one for each user and computer, shared by all installations."""

from __future__ import annotations

import contextlib
import hashlib
import os
import stat
import sys
import tempfile
import time
from pathlib import Path

# A file says so at its beginning; another number is another format.
_MAGIC = b"mckernel1\n"
_DIGEST = hashlib.sha256().digest_size
# What nobody has read for so long is removed [s]; a read is noted once a day.
_KEPT_S = 60 * 86400.0
_NOTED_S = 86400.0


def cache_folder() -> Path | None:
    """Return the folder, made if need be; None where nobody may write, or others may.

    It is ``$NUMBA_CACHE_DIR/mcserver-kernels``, or ``mcserver/kernels`` in the user's cache folder. What is
    in it runs as machine code: it has to belong to the user that runs it.
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
    """Return what was kept under a name; None where there is nothing, or nothing whole."""
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
    """Keep a payload under a name, at once or not at all; return whether it is there.

    Several processes may write the same name: each file is whole, and the last one stays.
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
        # read-only or full: it costs the time to compile again
        if temporary is not None:
            with contextlib.suppress(OSError):
                os.unlink(temporary)
        return False
    return True


def remove_unused() -> None:
    """Remove what nobody has read for two months, as of releases that are gone."""
    folder = cache_folder()
    if folder is None:
        return
    oldest = time.time() - _KEPT_S
    with contextlib.suppress(OSError):
        for path in folder.iterdir():
            with contextlib.suppress(OSError):
                if path.stat().st_mtime < oldest:
                    path.unlink()
