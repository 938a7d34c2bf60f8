"""One run of QEMU: what is booted, and what of its output is the command's."""

from __future__ import annotations

import os
import re
import secrets
import select
import shlex
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from deploy.qemu.errors import RigError
from deploy.qemu.initrd import archive
from deploy.qemu.kernel import Kernel

HERE = Path(__file__).parent
TOO_LATE = 124
DID_NOT_COME_UP = 125
QEMU = "qemu-system-x86_64"
REMEDY = "as root: apt-get install --no-install-recommends qemu-system-x86 busybox-static"
# named by dynamically linked programs
LOADER = b"/ld-linux"
LOG_LINES_SHOWN = 30
KEPT_VARIABLES = ("PYTEST_ADDOPTS", "CI")


@dataclass(frozen=True)
class Guest:
    """What runs in the machine.

    Attributes:
        command: for its shell. folder: where, the same path as here. limit_s: for boot and command [s].
    """

    command: str
    folder: Path
    memory_mib: int = 3072
    limit_s: float = 1200.0


def run(kernel: Kernel, guest: Guest, cache: Path, output: BinaryIO) -> int:
    """Boots, runs the command, passes its output on as it comes; gives its exit code.

    Raises:
        RigError: QEMU or busybox is not installed, or the machine ended before the command did.
    """
    qemu, busybox = shutil.which(QEMU), shutil.which("busybox")
    if qemu is None or busybox is None:
        raise RigError(f"{QEMU} or busybox is not installed", REMEDY)
    if LOADER in Path(busybox).read_bytes():
        raise RigError(f"{busybox} is not statically linked", REMEDY)
    with tempfile.TemporaryDirectory(prefix="run-", dir=cache) as folder:
        mark = f"rig-{secrets.token_hex(8)}"
        initrd, log = Path(folder, "initrd"), Path(folder, "console.log")
        initrd.write_bytes(initrd_of(kernel, Path(busybox).read_bytes(), script(guest, mark)))
        command = [qemu, *machine(guest), *boot(kernel.image, initrd), *devices(log)]
        running = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE)
        try:
            code = follow(chunks(running, guest.limit_s), mark.encode(), output)
            ended = running.poll() is not None
        finally:
            running.kill()
            running.wait()
            assert running.stdout is not None
            running.stdout.close()
        if code is not None:
            return code
        shown = log.read_text("utf-8", "replace").splitlines()[-LOG_LINES_SHOWN:] if log.exists() else []
    if not ended:
        output.write(f"\nrig: not done after {guest.limit_s:g} s\n".encode())
        output.flush()
        return TOO_LATE
    raise RigError("the machine ended before the command:\n" + "\n".join(shown), "see its console above")


def initrd_of(kernel: Kernel, busybox: bytes, command: str) -> bytes:
    """The guest's first file system. Busybox has to be statically linked."""
    modules = {f"modules/{path.name}": path.read_bytes() for path in kernel.modules}
    order = "".join(f"{path.name}\n" for path in kernel.modules)
    return archive(
        {
            "init": (HERE / "init").read_bytes(),
            "bin/busybox": busybox,
            "rig/command": command.encode(),
            "modules/order": order.encode(),
            **modules,
        }
    )


def script(guest: Guest, mark: str) -> str:
    """What the guest's shell runs on the host's files: the command, then the mark with its exit code."""
    kept = {name: os.environ[name] for name in KEPT_VARIABLES if name in os.environ}
    variables = {
        "PATH": os.environ.get("PATH", "/usr/sbin:/usr/bin:/sbin:/bin"),
        "HOME": os.environ.get("HOME", "/root"),
        "LC_ALL": "C.UTF-8",
        "TERM": "dumb",
        "PYTHONDONTWRITEBYTECODE": "1",
        "MC_CAN_REQUIRED": "1",
        # an emulated processor takes longer to load compiled loops than to interpret those of a short program
        "NUMBA_DISABLE_JIT": "1",
        **kept,
    }
    exports = "".join(f"export {name}={shlex.quote(value)}\n" for name, value in variables.items())
    # the shell is the guest's first process: it has to go on after the command whatever that did
    return (
        f"{exports}cd {shlex.quote(str(guest.folder))} && ( {guest.command} )\ncode=$?\n"
        f"printf '%s %s.' {mark} $code\nwhile :; do sleep 1000; done\n"
    )


def machine(guest: Guest) -> list[str]:
    """Processor and memory, emulated: a computer without KVM is enough.

    The guest's time is counted in instructions, 1 ns each, and goes as here where the guest waits: to its
    programs the processor is a quick one, however slowly or unevenly it is emulated.
    """
    processor = ["-accel", "tcg,thread=single", "-icount", "shift=0,sleep=on", "-cpu", "max"]
    return [
        "-M",
        "q35",
        *processor,
        "-m",
        str(guest.memory_mib),
        "-no-reboot",
        "-nodefaults",
        "-display",
        "none",
    ]


def boot(image: Path, initrd: Path) -> list[str]:
    """Kernel and its command line: a panic ends QEMU."""
    words = "console=ttyS0 loglevel=4 panic=-1 tsc=reliable random.trust_cpu=on mitigations=off"
    return ["-kernel", str(image), "-initrd", str(initrd), "-append", words]


def devices(log: Path) -> list[str]:
    """The console, the command's output, and the host's files, which the guest cannot change."""
    return [
        *["-serial", f"file:{log}", "-serial", "stdio"],
        *["-fsdev", "local,id=host,path=/,security_model=none,readonly=on,multidevs=remap"],
        *["-device", "virtio-9p-pci,fsdev=host,mount_tag=host"],
    ]


def chunks(running: subprocess.Popen[bytes], limit_s: float) -> Iterator[bytes]:
    """Output as it comes, until it ends or time is up."""
    assert running.stdout is not None
    end = time.monotonic() + limit_s
    while (left := end - time.monotonic()) > 0.0:
        if select.select([running.stdout], [], [], left)[0]:
            data = os.read(running.stdout.fileno(), 65536)
            if not data:
                running.wait(left)
                return
            yield data


def follow(data: Iterator[bytes], mark: bytes, output: BinaryIO) -> int | None:
    """Passes on all that comes before the mark; gives the exit code behind it, None where none came."""
    ending = re.compile(re.escape(mark) + rb" (\d+)\.")
    held = b""
    for each in data:
        held += each
        free = passable(held, mark)
        output.write(held[:free])
        output.flush()
        held = held[free:]
        found = ending.match(held)
        if found is not None:
            return int(found[1])
    output.write(held)
    output.flush()
    return None


def passable(held: bytes, mark: bytes) -> int:
    """How many bytes come before the mark, or before what may become one."""
    whole = held.find(mark)
    if whole >= 0:
        return whole
    begun = next((count for count in range(len(mark) - 1, 0, -1) if held.endswith(mark[:count])), 0)
    return len(held) - begun
