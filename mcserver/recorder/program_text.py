"""The text of programs for a recording, from the server's journal: also where the server is gone."""

from __future__ import annotations

import logging
from collections import OrderedDict
from pathlib import Path

import msgspec

from mcserver.errors import McError
from mcserver.recorder.channels import PROGRAM, ProgramPart
from mcserver.recorder.chunks import Chunk, ChunkBuilder
from mcserver.service.journal_reader import read_lines_near, read_programs
from mcserver.service.reports import Event

log = logging.getLogger(__name__)

# Lines around the one under way that a recording keeps of each program.
LINES_BEFORE, LINES_AFTER = 5_000, 5_000
LINES_A_MESSAGE = 500
# Programs whose text is kept, the latest ones.
MOST_PROGRAMS = 16


class ProgramsSeen:
    """The latest programs that events spoke of, and the line that each was at."""

    def __init__(self) -> None:
        self._seen: OrderedDict[str, int] = OrderedDict()

    def note(self, event: Event) -> None:
        """Look at an event."""
        if event.program is None:
            return
        line = max(self._seen.pop(event.program, 0), event.line, *(each.line for each in event.lines), 0)
        self._seen[event.program] = line
        while len(self._seen) > MOST_PROGRAMS:
            self._seen.popitem(last=False)

    def snapshot(self) -> list[tuple[str, int]]:
        """Return each program and the line it was at, the oldest first."""
        return list(self._seen.items())


def text_chunk(journal: Path, programs: list[tuple[str, int]], at_ns: int) -> Chunk | None:
    """A chunk with the text of some programs around the line that each was at; None where no program runs.

    A journal that cannot be read costs the text, not the recording.
    """
    builder = ChunkBuilder()
    for program, line in programs:
        try:
            name = next((each.name for each in read_programs(journal, limit=1, program=program)), "")
            first, lines = read_lines_near(journal, program, line - LINES_BEFORE, line + LINES_AFTER)
        except (OSError, McError, msgspec.MsgspecError) as error:
            log.warning("the text of %s is not in the recording: %s", program, error)
            continue
        for at in range(0, len(lines), LINES_A_MESSAGE):
            part = ProgramPart(program, name, first + at, lines[at : at + LINES_A_MESSAGE])
            builder.add_message(PROGRAM, at_ns, msgspec.json.encode(part))
    return builder.finish()
