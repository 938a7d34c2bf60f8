"""Remote methods for the machine file: reading by an engineer, checking, and writing at rest."""

from __future__ import annotations

import asyncio
from pathlib import Path

from mcserver.errors import Diagnostic, McError, Refused
from mcserver.machine.machine_file import parse_machine
from mcserver.net import machine_file_messages as wire
from mcserver.service.kept_file import replace_file
from mcserver.service.reports import wire_diagnostic
from mcserver.service.service import MachineService
from mcserver.service.service_options import LoadedFile
from mcserver.simulation.machine_faults import find_machine_faults


class MachineFileMethods:
    """Reads and writes the file that the server was started with."""

    def __init__(self, service: MachineService) -> None:
        self._service = service
        self._turn = asyncio.Lock()

    async def machine_file(self, _client: str, _request: wire.MachineFileRequest) -> wire.MachineFileReply:
        loaded = self._loaded()
        text = await asyncio.to_thread(_read, loaded.path)
        digest = _digest(text)
        return wire.MachineFileReply(loaded.path.name, text, digest, digest == loaded.sha256)

    async def write_machine_file(
        self, client: str, request: wire.WriteMachineFileRequest
    ) -> wire.WriteMachineFileReply:
        path = self._loaded().path
        async with self._turn:
            self._refuse_at_work()
            # refuse if the file has changed since the engineer read it
            before = await asyncio.to_thread(_read, path)
            if _digest(before) != request.sha256:
                raise Refused(
                    "MC598", f"{path.name} has changed meanwhile", "look at it again, then change it"
                )
            found = await asyncio.to_thread(_faults, request.text, path)
            ok = all(each.severity != "error" for each in found)
            shown = [wire_diagnostic(each) for each in found]
            if request.only_check or not ok:
                return wire.WriteMachineFileReply(False, "", shown)
            # a program may have begun during the check
            self._refuse_at_work()
            kept = path.with_name(f"{path.name}.before")
            try:
                await asyncio.to_thread(_write, path, kept, request.text)
            except OSError as error:
                raise Refused(
                    "MC599",
                    f"{path.name} cannot be written: {error.strerror}",
                    "give the server's user the folder, and its unit ReadWritePaths",
                ) from error
        who = f" by {request.by}" if request.by else ""
        detail = f"{path.name}{who}: {changed(before, request.text)}"
        self._service.record_command(client, "write_machine_file", detail=detail)
        return wire.WriteMachineFileReply(True, kept.name, shown)

    def _loaded(self) -> LoadedFile:
        loaded = self._service.options.machine_file
        if loaded is None:
            message = f"{self._service.machine.name} is a built-in machine"
            raise Refused("MC597", message, "mcserver machine show prints one to change")
        return loaded

    def _refuse_at_work(self) -> None:
        """Refuse while programs run: checking takes seconds of a core."""
        busy = next((each for each in self._service.current() if not each.ended), None)
        if busy is not None:
            raise Refused("MC512", f"{busy.name or busy.program} is open", "wait for its end, or abort it")


def changed(before: str, after: str) -> str:
    """Return which lines differ, for the journal, such as ``lines 7-9``."""
    old, new = before.splitlines(), after.splitlines()
    head = next((at for at, pair in enumerate(zip(old, new, strict=False)) if pair[0] != pair[1]), None)
    if head is None:
        head = min(len(old), len(new))
    tail = 0
    while tail < min(len(old), len(new)) - head and old[-1 - tail] == new[-1 - tail]:
        tail += 1
    return f"lines {head + 1} to {len(old) - tail} are now {head + 1} to {len(new) - tail}"


def _faults(text: str, path: Path) -> list[Diagnostic]:
    try:
        machine = parse_machine(text, source=path.name, folder=path.parent)
        return find_machine_faults(machine, text)
    except McError as error:
        diagnostics: tuple[Diagnostic, ...] = getattr(error, "diagnostics", ())
        return list(diagnostics) or [Diagnostic(code=error.code, message=error.message, hint=error.hint)]


def _read(path: Path) -> str:
    try:
        # as bytes: reading as text would change line ends
        return path.read_bytes().decode("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise Refused("MC599", f"{path.name} cannot be read: {error}", "look at the file") from error


def _write(path: Path, kept: Path, text: str) -> None:
    mode = path.stat().st_mode & 0o777
    for target, content in ((kept, path.read_bytes()), (path, text.encode("utf-8"))):
        replace_file(target, content)
        # keep it readable for others
        target.chmod(mode)


def _digest(text: str) -> str:
    return LoadedFile.digest(text.encode("utf-8"))
