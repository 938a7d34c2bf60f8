"""``python -m deploy.qemu [--timeout S] [--] COMMAND …``: runs a command in a machine that has CAN.

Its output and its exit code are the command's; 124: it did not end in time, 125: the machine did not come up.
The command runs as root in the present folder, on vcan0 … vcan3; what it writes is gone with the machine.
"""

from __future__ import annotations

import argparse
import os
import shlex
import sys
from pathlib import Path

from deploy.qemu.errors import RigError
from deploy.qemu.guest import DID_NOT_COME_UP, Guest, run
from deploy.qemu.kernel import kernel

ROOT = Path(__file__).resolve().parents[2]
CACHE = ROOT / ".qemu"
SUITE = (sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "tests/socketcan")


def main() -> int:
    """The command's exit code, or one of the rig's own."""
    options = argparse.ArgumentParser(prog="python -m deploy.qemu", description=__doc__)
    options.add_argument("--timeout", type=float, default=1800.0, metavar="S", help="for boot and command")
    options.add_argument("--memory", type=int, default=3072, metavar="MIB")
    options.add_argument("command", nargs="*", help="default: the SocketCAN suite")
    chosen = options.parse_args()
    guest = Guest(
        command=shlex.join(chosen.command or SUITE),
        folder=Path.cwd(),
        memory_mib=chosen.memory,
        limit_s=chosen.timeout,
    )
    try:
        return run(kernel(CACHE), guest, CACHE, sys.stdout.buffer)
    except RigError as error:
        sys.stderr.write(f"error: {error}\n")
        return DID_NOT_COME_UP


if __name__ == "__main__":
    os.environ.setdefault("LC_ALL", "C.UTF-8")
    sys.exit(main())
