"""What the executor's thread asks of Linux."""

from __future__ import annotations

import subprocess
import sys

RELEASED = """
from pathlib import Path
import llvmlite.binding as llvm
from mcserver.executor.realtime import release_libraries

def resident():
    total, inside = 0, False
    for line in Path("/proc/self/smaps").read_text().splitlines():
        first, *rest = line.split()
        if not first.endswith(":"):
            inside = "libllvmlite" in rest[-1]
        elif inside and first == "Rss:":
            total += int(rest[0])
    return total

llvm.initialize_native_target()
before = resident()
release_libraries("libllvmlite")
after = resident()
assert 0 < after < before // 2, (before, after)
print(llvm.parse_assembly("define double @one() {\\n ret double 1.0\\n}").get_function("one").name)
"""


def test_a_library_that_was_released_gives_its_memory_back_and_still_works() -> None:
    done = subprocess.run([sys.executable, "-c", RELEASED], capture_output=True, text=True, timeout=60)
    assert (done.stdout, done.stderr, done.returncode) == ("one\n", "", 0)
