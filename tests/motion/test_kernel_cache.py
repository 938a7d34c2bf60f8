"""Machine code of kernels on disk: never out of date, whole or not there, and never a reason to fail."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from mcserver.cli import planner_warm_up
from mcserver.motion import compiling
from mcserver.motion.compiling import compiling_alone, kernels_kept, note_kernels_kept
from mcserver.motion.kernels.cache_folder import cache_folder, read, remove_unused, write
from mcserver.motion.kernels.compiled import compiled
from mcserver.motion.kernels.function_digest import function_digest

CALLER = """
{comment}
from mcserver.motion.kernels.compiled import compiled
SCALE = {scale}

@compiled
def callee(x: float) -> float:
    "{docstring}"
    return x {operator} SCALE

@compiled
def caller(x: float) -> float:
    return callee(x) + 1.0
"""


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))


def kernels(*, comment: str = "", docstring: str = "", operator: str = "*", scale: float = 2.0) -> Any:
    module = ModuleType("kernels")
    text = CALLER.format(comment=comment, docstring=docstring, operator=operator, scale=scale)
    exec(compile(text, "kernels.py", "exec"), module.__dict__)
    return module


def kept() -> list[str]:
    folder = cache_folder()
    assert folder is not None
    return sorted(path.name for path in folder.iterdir())


def test_a_kernel_is_compiled_once_and_read_afterwards() -> None:
    first, second = kernels().caller, kernels().caller
    assert (first(3.0), second(3.0)) == (7.0, 7.0)
    assert sum(first.stats.cache_hits.values()) == 0
    assert sum(second.stats.cache_hits.values()) == 1
    assert not second.stats.cache_misses


def test_a_change_of_a_callee_alone_makes_its_callers_anew() -> None:
    """numba's own cache would go on with the old one: its issue 1833."""
    assert kernels().caller(3.0) == 7.0
    assert kernels(operator="+").caller(3.0) == 6.0


def test_a_change_of_a_constant_that_a_callee_reads_makes_its_callers_anew() -> None:
    assert kernels().caller(3.0) == 7.0
    assert kernels(scale=3.0).caller(3.0) == 10.0


def test_comments_docstrings_and_line_numbers_compile_nothing() -> None:
    before = function_digest(kernels().caller)
    assert function_digest(kernels(comment="# one\n\n# more", docstring="doubled").caller) == before
    assert function_digest(kernels(scale=2.5).caller) != before


def test_a_kernel_is_compiled_beside_a_kept_one_that_it_calls() -> None:
    """What is kept has to serve the compiler too, not only the processor."""
    assert kernels().callee(3.0) == 6.0
    module = kernels()
    assert module.caller(3.0) == 7.0
    assert sum(module.callee.stats.cache_hits.values()) == 1
    assert sum(module.caller.stats.cache_misses.values()) == 1


def test_kept_kernels_are_read_without_the_library_of_numba(tmp_path: Path) -> None:
    """It brings scipy with it, and takes longer than reading all kernels of a server."""
    file = tmp_path / "lonely.py"
    file.write_text(
        CALLER.format(comment="", docstring="", operator="*", scale=2.0)
        + "import sys\nassert caller(3.0) == 7.0\n"
        + "print([each for each in ('numba.np.linalg', 'scipy.linalg') if each in sys.modules])\n"
    )
    found = [
        subprocess.run([sys.executable, str(file)], capture_output=True, text=True, check=True).stdout
        for _ in range(2)
    ]
    # the one that compiles needs it
    assert "numba.np.linalg" in found[0]
    assert found[1] == "[]\n"


def test_each_signature_has_a_file_of_its_own() -> None:
    caller = kernels().caller
    assert (caller(3.0), caller(3)) == (7.0, 7.0)
    again = kernels().caller
    assert (again(3), again(3.0)) == (7.0, 7.0)
    assert sum(again.stats.cache_hits.values()) == 2


@pytest.mark.parametrize("damage", ["cut", "flipped", "empty", "foreign"])
def test_a_damaged_file_costs_the_time_to_compile(damage: str) -> None:
    assert kernels().caller(3.0) == 7.0
    folder = cache_folder()
    assert folder is not None
    for name in kept():
        content = bytearray((folder / name).read_bytes())
        if damage == "cut":
            del content[len(content) // 2 :]
        elif damage == "flipped":
            content[-20] ^= 1
        (folder / name).write_bytes({"empty": b"", "foreign": b"something else"}.get(damage, bytes(content)))
    again = kernels().caller
    assert again(3.0) == 7.0
    assert not again.stats.cache_hits


def test_whole_files_that_hold_something_else_cost_the_time_to_compile() -> None:
    assert kernels().caller(3.0) == 7.0
    for name in kept():
        assert write(name, b"no pickle")
    assert kernels().caller(3.0) == 7.0


def test_a_full_disk_costs_the_time_to_compile(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "replace", full)
    assert kernels().caller(3.0) == 7.0
    assert kept() == []


def test_a_folder_that_cannot_be_made_costs_the_time_to_compile(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file"))
    assert cache_folder() is None
    assert kernels().caller(3.0) == 7.0
    with compiling_alone() as alone:
        assert alone


def test_machine_code_that_others_could_have_written_is_not_run() -> None:
    folder = cache_folder()
    assert folder is not None
    write("name", b"payload")
    assert read("name") == b"payload"
    folder.chmod(0o777)
    assert cache_folder() is None
    assert read("name") is None


def test_what_nobody_reads_for_months_is_removed() -> None:
    write("old", b"1")
    write("new", b"2")
    folder = cache_folder()
    assert folder is not None
    os.utime(folder / "old", (0.0, 0.0))
    remove_unused()
    assert kept() == ["new"]


def test_kernels_with_an_underscore_are_called_by_kernels() -> None:
    @compiled
    def _inner(x: float) -> float:
        return x / 0.0

    @compiled
    def outer(x: float) -> float:
        return _inner(x)

    assert outer(1.0) == float("inf")


def test_the_cache_is_complete_for_these_sources_only(monkeypatch: pytest.MonkeyPatch) -> None:
    assert not kernels_kept()
    note_kernels_kept()
    assert kernels_kept()
    monkeypatch.setattr(compiling, "version", lambda name: f"another {name}")
    assert not kernels_kept()


def test_one_process_compiles_and_others_know_it() -> None:
    asked = "from mcserver.motion.compiling import *\nwith compiling_alone(wait=False) as a: print(a)"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    with compiling_alone() as alone:
        assert alone
        answer = subprocess.run(
            [sys.executable, "-c", asked.replace("*", "compiling_alone")],
            env=environment,
            capture_output=True,
            text=True,
            timeout=300,
            check=True,
        )
    assert answer.stdout.strip() == "False"


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What a command does about kernels that are not there."""
    calls: list[str] = []

    def plain() -> bool:
        calls.append("plain")
        return True

    monkeypatch.setattr(planner_warm_up, "plain_kernels", lambda: False)
    monkeypatch.setattr(planner_warm_up, "use_plain_kernels", plain)
    monkeypatch.setattr(planner_warm_up, "start_compiling", lambda: calls.append("background"))
    monkeypatch.setattr("mcserver.motion.warm_up.warm_up", lambda: calls.append("compiled"))
    return calls


def test_a_short_program_does_not_wait_for_the_compiler(started: list[str]) -> None:
    planner_warm_up.prepare_planner(20)
    assert started == ["plain", "background"]


def test_a_long_program_waits_for_the_compiler(started: list[str]) -> None:
    planner_warm_up.prepare_planner(100_000)
    assert started == ["compiled"]


def test_with_kernels_at_hand_nothing_is_prepared(started: list[str]) -> None:
    note_kernels_kept()
    planner_warm_up.prepare_planner(20)
    assert started == []
