"""The machine file by remote: never written with an error, at work, or over what nobody has seen."""

from __future__ import annotations

import stat
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from mcserver.errors import Refused
from mcserver.machine.machine_file import builtin_text
from mcserver.net.machine_file_messages import (
    MachineFileReply,
    MachineFileRequest,
    WriteMachineFileReply,
    WriteMachineFileRequest,
)
from mcserver.net.machine_file_methods import MachineFileMethods, changed
from mcserver.service.service_options import LoadedFile
from mcserver.web.panels.machine_file import difference_html, faults_html

TEXT = builtin_text("cartesian")
SLOWER = TEXT.replace("max_velocity = 1000.0", "max_velocity = 900.0", 1)
FAULTY = SLOWER.replace("max_acceleration", "max_acelleration", 1)
assert TEXT != SLOWER != FAULTY


class Rig:
    """A server that was started with a file."""

    def __init__(self, path: Path | None) -> None:
        self.said: list[tuple[Any, ...]] = []
        self.programs: list[Any] = []
        service = SimpleNamespace(
            options=SimpleNamespace(machine_file=None if path is None else LoadedFile.of(path)),
            machine=SimpleNamespace(name="cartesian"),
            current=lambda: self.programs,
            record_command=lambda client, method, *, detail: self.said.append((client, method, detail)),
        )
        self.methods = MachineFileMethods(cast(Any, service))

    async def read(self) -> MachineFileReply:
        return await self.methods.machine_file("page", MachineFileRequest())

    async def write(self, text: str, sha256: str, *, only_check: bool = False) -> WriteMachineFileReply:
        request = WriteMachineFileRequest(text=text, sha256=sha256, only_check=only_check, by="ada")
        return await self.methods.write_machine_file("page", request)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    made = tmp_path / "cell.toml"
    made.write_text(TEXT)
    made.chmod(0o644)
    return made


async def test_a_text_that_checks_is_written_and_the_old_one_is_kept_beside_it(path: Path) -> None:
    rig = Rig(path)
    found = await rig.read()
    assert (found.name, found.text, found.in_force) == ("cell.toml", TEXT, True)
    checked = await rig.write(SLOWER, found.sha256, only_check=True)
    assert (checked.written, path.read_text(), rig.said) == (False, TEXT, [])
    reply = await rig.write(SLOWER, found.sha256)
    assert (reply.written, reply.before) == (True, "cell.toml.before")
    assert (path.read_text(), path.with_name(reply.before).read_text()) == (SLOWER, TEXT)
    assert stat.S_IMODE(path.stat().st_mode) == 0o644
    ((client, method, detail),) = rig.said
    assert (client, method) == ("page", "write_machine_file")
    assert detail.startswith("cell.toml by ada: lines ")
    assert not (await rig.read()).in_force


async def test_a_text_with_an_error_is_never_written_and_each_mistake_has_its_line(path: Path) -> None:
    rig = Rig(path)
    reply = await rig.write(FAULTY, (await rig.read()).sha256)
    assert (reply.written, path.read_text()) == (False, TEXT)
    errors = [each for each in reply.diagnostics if each.severity == "error"]
    lines = FAULTY.splitlines()
    assert any(lines[each.line - 1].startswith("max_acelleration") for each in errors)
    assert {each.code for each in errors} == {"MC003"}
    for garbage in ("", "[", "a = 1", "[machine]\n" * 9):
        assert not (await rig.write(garbage, (await rig.read()).sha256)).written


async def test_nothing_is_written_over_what_nobody_has_seen_or_beside_a_program(path: Path) -> None:
    rig = Rig(path)
    seen = (await rig.read()).sha256
    rig.programs = [SimpleNamespace(ended=False, name="part.nc", program="p")]
    with pytest.raises(Refused, match=r"MC512.*part\.nc"):
        await rig.write(SLOWER, seen)
    rig.programs = []
    path.write_text(TEXT + "# by hand\n")
    with pytest.raises(Refused, match="MC598"):
        await rig.write(SLOWER, seen)
    with pytest.raises(Refused, match="MC597"):
        await Rig(None).read()


async def test_a_file_with_other_ends_of_lines_is_the_one_that_was_loaded(path: Path) -> None:
    path.write_bytes(TEXT.replace("\n", "\r\n").encode())
    rig = Rig(path)
    read = await rig.read()
    assert read.in_force
    assert (await rig.write(SLOWER, read.sha256)).written
    assert path.with_name("cell.toml.before").read_bytes() == read.text.encode()


def test_a_difference_and_its_faults_are_shown_as_text() -> None:
    assert changed("a\nb\nc", "a\nx\ny\nc") == "lines 2 to 2 are now 2 to 3"
    assert "<script>" not in difference_html("a", "<script>alert(1)</script>")
    assert "nothing wrong" in faults_html([])
