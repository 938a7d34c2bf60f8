"""The first start after an installation: which process compiles the kernels, and which ones wait for it.

Imports neither numba nor a kernel, so that a process that only waits starts fast.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import platform
import subprocess
import sys
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

from mcserver.motion.kernels.cache_folder import cache_folder, read, write

COMPILING = "compiling the planner for this computer: once, a minute or two …"
COMPILING_EXECUTOR = (
    "compiling the executor for this computer: once, some 20 s; "
    "programs are planned without machine code until the planner's is there, too …"
)
PLAIN = "planning without machine code, which is made in the background, once for this computer"
# A start from the cache takes less than this [s].
PATIENCE_S = 3.0
# A program of up to so many lines is planned sooner in plain Python (5-50 ms a line) than compiled for.
SHORT_LINES = 300
# Niceness of the process that compiles in the background.
NICE = 10
# Environment in which a process runs kernels as plain Python.
DISABLE_JIT = {"NUMBA_DISABLE_JIT": "1"}
# Argument of the process that compiles in the background.
BACKGROUND = "background"


def plain_kernels() -> bool:
    """Return whether kernels run as plain Python: ``NUMBA_DISABLE_JIT=1``."""
    return os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0")


def needs_compiler() -> bool:
    """Return whether kernels are missing from a cache that can be written: another process may fill it."""
    folder = cache_folder()
    keeps = folder is not None and os.access(folder, os.W_OK)
    return keeps and not (plain_kernels() or kernels_kept())


def kernels_kept() -> bool:
    """Return whether all kernels of these sources are in the cache, for this computer."""
    return read(_marker()) is not None


def note_kernels_kept() -> None:
    """Note that all kernels of these sources are in the cache."""
    write(_marker(), b"complete")


def _marker() -> str:
    """Name the file that marks all kernels as compiled, by a digest of sources, versions and processor."""
    digest = hashlib.sha256()
    folder = Path(__file__).parent
    for path in sorted(folder.rglob("*.py")):
        digest.update(path.relative_to(folder).as_posix().encode())
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    for each in ("numba", "llvmlite", "numpy"):
        digest.update(version(each).encode())
    digest.update(f"{sys.version} {platform.machine()} {_processor()}".encode())
    return f"complete-{digest.hexdigest()[:40]}"


def _processor() -> str:
    """Return the processor's model and features: a cache may be on a disk that several computers share."""
    with contextlib.suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return " ".join(
            sorted({each for each in lines if each.startswith(("model name", "flags", "Features"))})
        )
    return platform.processor()


def use_plain_kernels() -> bool:
    """Make this process run kernels as plain Python; return False if they have been imported already."""
    if "mcserver.motion.kernels.compiled" in sys.modules:
        return False
    os.environ.update(DISABLE_JIT)
    return True


def start_compiling() -> None:
    """Start a process that compiles all kernels and outlives this one.

    Does nothing without a cache folder, or while another process compiles.
    """
    if cache_folder() is not None:
        with compiling_alone(wait=False) as alone:
            if not alone:
                return
        start_warm_up(BACKGROUND)


def start_warm_up(part: str) -> subprocess.Popen[bytes]:
    """Start ``python -m mcserver.motion.warm_up`` with a part, or in the background."""
    environment = dict(os.environ, PYTHONPATH=os.pathsep.join(os.path.abspath(path) for path in sys.path))
    environment.pop("NUMBA_DISABLE_JIT", None)
    detached = part == BACKGROUND
    return subprocess.Popen(
        [sys.executable, "-m", "mcserver.motion.warm_up", part],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL if detached else None,
        env=environment,
        start_new_session=detached,
        cwd="/" if detached else None,
    )


@contextlib.contextmanager
def compiling_alone(*, wait: bool = True) -> Iterator[bool]:
    """Hold the lock on compiling these sources, so that several first starts do not repeat the work.

    Yields:
        False where another process holds it and ``wait`` is False; True also where no file can be locked.
    """
    folder = cache_folder()
    if folder is None:
        yield True
        return
    with contextlib.ExitStack() as stack:
        yield _locked(folder, stack, wait)


def _locked(folder: Path, stack: contextlib.ExitStack, wait: bool) -> bool:
    if sys.platform == "win32":
        return True
    import fcntl

    try:
        # the lock ends when the file is closed or the process ends
        lock = stack.enter_context((folder / f"lock-{_marker()}").open("ab"))
        fcntl.flock(lock, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except BlockingIOError:
        return False
    except OSError:
        # the folder is read-only, or its file system has no locks
        return True
    return True
