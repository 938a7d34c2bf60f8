"""What server and recorder say to each other over their pipe, as MessagePack."""

from __future__ import annotations

from typing import Literal

import msgspec

from mcserver.machine.machine_file import Machine
from mcserver.service.reports import Event


class RecorderStart(msgspec.Struct, frozen=True):
    """What the process is given on standard input.

    Attributes:
        memory: descriptor of the executor's shared memory. pipe: descriptor of its end of the pipe.
        epoch: Unix time of executor time 0 [s]. folder: where files go.
        journal: read for the text of programs.
    """

    machine: Machine
    memory: int
    pipe: int
    epoch: float
    instance: str
    folder: str
    journal: str


class ServiceEvents(msgspec.Struct, frozen=True, tag="events"):
    """Events of the service; ``lost`` of them found no room since the last message."""

    events: list[Event]
    lost: int = 0


class StartRecording(msgspec.Struct, frozen=True, tag="start"):
    """Records into a file from now on; ``max_s`` None: until it is stopped."""

    ticket: int
    name: str = ""
    max_s: float | None = None


class StopRecording(msgspec.Struct, frozen=True, tag="stop"):
    """Ends a recording; without a name the only one."""

    ticket: int
    name: str = ""


class SaveBlackBox(msgspec.Struct, frozen=True, tag="save"):
    """Writes out the last minutes now."""

    ticket: int
    reason: str = "asked"


class AskStatus(msgspec.Struct, frozen=True, tag="status"):
    """How much is held, and what is being written."""

    ticket: int


class Quit(msgspec.Struct, frozen=True, tag="quit"):
    """Finish the files and end."""


Command = ServiceEvents | StartRecording | StopRecording | SaveBlackBox | AskStatus | Quit


class RecorderStatus(msgspec.Struct, frozen=True):
    """The recorder.

    Attributes:
        held_s, held_bytes: of the black box in memory. missed_cycles: since the start; the recorder came too
            late for them. writing: names of the recordings under way.
    """

    held_s: float
    held_bytes: int
    missed_cycles: int
    writing: list[str]


class Answer(msgspec.Struct, frozen=True, tag="answer"):
    """Answer to the command of that ticket: a recording's name or a status, or a code and a message."""

    ticket: int
    name: str = ""
    status: RecorderStatus | None = None
    code: str = ""
    message: str = ""
    hint: str = ""


class Saved(msgspec.Struct, frozen=True, tag="saved"):
    """A file is whole, black box or recording; why it was written."""

    name: str
    reason: str
    size: int


class Trouble(msgspec.Struct, frozen=True, tag="trouble"):
    """Something the operator should know: a code and a sentence."""

    code: Literal["MC582", "MC583"]
    message: str


Report = Answer | Saved | Trouble
