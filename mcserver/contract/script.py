"""A scripted exchange about one program's lines: the server's own bookkeeping answers; every step is noted.

The program and its queue are those of the service; what is left out is the planner, whose verdicts and
progress the script gives.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import msgspec

from mcserver.contract.vectors import plain
from mcserver.errors import Diagnostic, Refused, RejectedLines
from mcserver.net.messages import CloseReply, ErrorReply, OpenReply, SubmitReply
from mcserver.net.recovery_messages import ContinueReply
from mcserver.net.rpc import encode_error
from mcserver.service.line_intake import numbers_of, take_lines
from mcserver.service.line_queue import LineQueue
from mcserver.service.program import Program
from mcserver.service.program_options import ProgramOptions
from mcserver.service.reports import Ack, Fault, ProgramState, wire_diagnostic

PROGRAM = "b4c1-1"
CLIENT = "contract-1"


class Script:
    """Notes the steps of one sequence.

    Args:
        name: of the sequence and of its file.
        why: what a client has to get right.
        chunk_lines: how many lines the client may put into one message.
        room: how many lines wait at the server at most: the credit.
        puts_only: for clients that put lines without waiting for a reply each.
    """

    def __init__(
        self,
        name: str,
        why: str,
        *,
        chunk_lines: int = 100,
        room: int = 100,
        start_line: int = 1,
        puts_only: bool = False,
    ) -> None:
        self._head = {"name": name, "why": why, "chunk_lines": chunk_lines, "puts_only": puts_only}
        self._steps: list[dict[str, Any]] = []
        self._given: dict[int, str] = {}
        self._next = start_line
        self._messages: list[tuple[int, list[str], int]] = []
        # rejections that the client has heard of, and the number that one it has not heard of gives back
        self._heard = 0
        self._unheard = 0
        self.program = program_of(PROGRAM, start_line, room)
        self._note("open", shown_message(OpenReply(**_opened(self.program))))

    def sequence(self) -> dict[str, Any]:
        return {**self._head, "steps": self._steps}

    # ------------------------------------------------------------ the application

    def give(self, *lines: str) -> None:
        """The application gives lines to be streamed."""
        for line in lines:
            self._given[self._next] = line
            self._next += 1
        self._note("give", list(lines))

    def judge(self, line: str) -> None:
        """The application sends one line and waits for the verdict."""
        self._given[self._next] = line
        self._next += 1
        self._note("judge", line)

    # ------------------------------------------------------------ the client

    def sends(self, first: int, last: int) -> None:
        """The client sends these lines as one message, which the server gets unless it is lost."""
        lines = [self._given[number] for number in range(first, last + 1)]
        self._messages.append((first, lines, self._heard))
        self._note("sends", {"first": first, "lines": lines, "rejections": self._heard})

    def exchange(self, first: int, last: int) -> None:
        """The client sends these lines, and the server takes and answers them."""
        self.sends(first, last)
        self.answer()

    def settled(self) -> None:
        """The client sends nothing more, and knows what the server has."""
        self.quiet()
        self.knows()

    def quiet(self) -> None:
        self._note("quiet", True)

    def closes(self, last: int) -> None:
        """The client closes behind its last line."""
        self._note("closes", {"last": last})
        self.program.closed = True
        self._answer(self._close_reply())

    def knows(self) -> None:
        """What the client shows of the program is what the server has."""
        program = self.program
        self._note("knows", {"accepted": program.journaled, "done": program.done, "state": program.state})

    def fails(self, code: str, **place: int | str) -> None:
        """The application learns a failure."""
        self._note("fails", {"code": code, **place})

    # ------------------------------------------------------------ the network and the server

    def message_lost(self) -> None:
        """The message sent last does not arrive."""
        self._messages.pop()
        self._note("lost", "the message")

    def answer_lost(self) -> None:
        """The server takes the oldest message, and its answer does not arrive."""
        self._receive()
        self._note("lost", "the answer")

    def answer(self) -> None:
        """The server takes the oldest message and answers it."""
        self._answer(self._receive())

    def rejects_at_once(self, line: int, diagnostic: Diagnostic) -> None:
        """The server takes the oldest message and finds a line of it faulty before it answers."""
        self._receive()
        self._reject(line, diagnostic)
        self._refuse()

    def rejects_and_says_so(self, line: int, diagnostic: Diagnostic) -> None:
        """As `rejects_at_once`, and an acknowledgement overtakes the answer."""
        self._receive()
        self._reject(line, diagnostic)
        self.ack()
        self._refuse()

    def _refuse(self) -> None:
        refused = RejectedLines(self.program.diagnostics, **numbers_of(self.program))
        self._answer(error_message(refused))

    def runs(self, through: int) -> None:
        """The planner has taken lines and they have run; an acknowledgement says so."""
        self._run(through)
        self.ack()

    def ack(self, expected: int = 0) -> None:
        """An acknowledgement comes by itself."""
        self._note("ack", shown_message(self.program.ack(expected)))
        self._hear()

    def keep_ack(self) -> Ack:
        """An acknowledgement goes out and comes late, or a second time."""
        return self.program.ack()

    def late_ack(self, ack: Ack) -> None:
        """An acknowledgement comes that is older than what the client knows."""
        self._note("ack", shown_message(ack))

    def foreign_ack(self, accepted: int, credit: int) -> None:
        """An acknowledgement with numbers that are not the server's now."""
        self.late_ack(msgspec.structs.replace(self.program.ack(), accepted=accepted, credit=credit))

    def rejects(self, line: int, diagnostic: Diagnostic) -> None:
        """A line that was accepted turns out faulty once it is planned."""
        self._reject(line, diagnostic)
        self.ack()

    def rejects_unheard(self, line: int, diagnostic: Diagnostic) -> None:
        """As `rejects`, and the acknowledgement is lost."""
        self.program.reject(line, [wire_diagnostic(diagnostic)])
        self._unheard = line

    def ends(self, state: ProgramState, fault: Fault | None = None, reason: str = "") -> None:
        """The program ends; the acknowledgement says how."""
        self.program.fault = fault
        self.program.reason = reason
        if state == "finished":
            self._run(self.program.journaled)
        self.program.state = state
        self.ack()

    def enters(self, state: ProgramState) -> None:
        self.program.state = state
        self.ack()

    def asked(self) -> None:
        """The client, in doubt or on a new connection, asks `programs`."""
        self._note("asked", shown_message(self.program.status()))
        self._hear()

    def asked_after_restart(self) -> None:
        """The server has been restarted since and knows the program no more (MC503)."""
        self._note("asked", None)

    def continues(self, line: int, *, whole: bool = False) -> None:
        """Another program goes on with this one, of which the journal has all lines that were accepted."""
        former = self.program.journaled
        self._heard = self._unheard = 0
        self.program = program_of("c7d0-1", line, former + 100)
        self.program.queue.take(line, [self._given[number] for number in range(line, former + 1)])
        self.program.journaled, self.program.closed, self._next = former, whole, former + 1
        reply = ContinueReply(**_opened(self.program), line=line, resume_of=PROGRAM, whole=whole)
        self._note("continues", shown_message(reply))

    # ------------------------------------------------------------ the server's bookkeeping

    def _receive(self) -> dict[str, Any]:
        """Take the oldest message as the service does, and give the reply to a `submit` of it."""
        first, lines, rejections = self._messages.pop(0)
        program = self.program
        try:
            taken = take_lines(program, first, lines, rejections)
        except Refused as refused:
            gap = rejections == program.epoch and refused.code == "MC505"
            said = {"ack": shown_message(program.ack(program.queue.expected))} if gap else {}
            return error_message(refused) | said
        program.journaled = program.queue.accepted
        if taken is not None:
            program.rejected, program.diagnostics = 0, []
        return {
            "reply": shown_message(
                SubmitReply(program.program, program.journaled, program.done, program.credit, program.epoch)
            )
        }

    def _reject(self, line: int, diagnostic: Diagnostic) -> None:
        self.program.reject(line, [wire_diagnostic(diagnostic)])
        self._next = line

    def _run(self, through: int) -> None:
        self.program.queue.consume(through)
        self.program.progress.passed(through)
        self.program.done = through

    def _hear(self) -> None:
        """The client has been reached by what the server has to say."""
        self._heard = self.program.epoch
        if self._unheard:
            self._next, self._unheard = self._unheard, 0

    def _close_reply(self) -> dict[str, Any]:
        program = self.program
        return {
            "reply": shown_message(
                CloseReply(program.program, program.journaled, program.done, program.state)
            )
        }

    def _answer(self, reply: dict[str, Any]) -> None:
        self._note("answer", {"ack": shown_message(self.program.ack()), **reply})
        self._hear()

    def _note(self, what: str, value: object) -> None:
        self._steps.append({what: value})


def lines(count: int, *, start: int = 1) -> Sequence[str]:
    """Lines that can be distinguished."""
    return [f"G01 X{number}" for number in range(start, start + count)]


def program_of(name: str, start_line: int, room: int) -> Program:
    """Return a program of the contract's client that runs, with room for lines."""
    program = Program(
        name,
        CLIENT,
        (0, 1, 2),
        ProgramOptions(name="contract", start_line=start_line),
        opened_at=0.0,
        queue=LineQueue(start_line, limit_lines=room),
    )
    program.state = "running"
    return program


def _opened(program: Program) -> dict[str, Any]:
    return {
        "program": program.program,
        "state": program.state,
        "axes": list(program.axes),
        "expected": program.queue.expected,
        "credit": program.credit,
        "instance": program.program.partition("-")[0],
    }


Played = TypeVar("Played")


def scripted(
    kind: Callable[..., Played], why: str, **options: Any
) -> Callable[[Callable[[Played], None]], Callable[[], Played]]:
    """Turn a function that plays a script into a sequence of its name; ``why`` and options as of ``kind``."""

    def made(play: Callable[[Played], None]) -> Callable[[], Played]:
        def sequence() -> Played:
            script = kind(play.__name__.strip("_").replace("_", " "), why, **options)
            play(script)
            return script

        return sequence

    return made


def error_message(error: BaseException) -> dict[str, Any]:
    """Return the step of a refusal."""
    return {"refused": shown_message(msgspec.msgpack.decode(encode_error(error), type=ErrorReply))}


def shown_message(value: msgspec.Struct) -> dict[str, Any]:
    """Return a message as the files of the contract show it."""
    return {"bytes": msgspec.msgpack.encode(value).hex(), "value": plain(value)}
