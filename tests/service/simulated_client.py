"""A client of the simulated cell: lines over a network that loses, doubles and delays them."""

from __future__ import annotations

from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING

from mcserver.errors import Refused, RejectedLines, ServiceError
from mcserver.service.program_options import ProgramOptions
from mcserver.service.reports import ENDED, Ack
from tests.service.simulated_laws import require

if TYPE_CHECKING:
    from tests.service.simulated_cell import Cell


class SimulatedClient:
    """Sends a program over a bad network, and again what is not acknowledged, as docs/wire/lines.md says.

    Some lines are faulty, up to twice in a row; each text that it gives is another one, so that what runs
    under a number can be held against what it takes for accepted.
    """

    def __init__(self, cell: Cell, name: str, lines: int, axes: list[int]) -> None:
        self.name = name
        self.done = False
        self._cell = cell
        self._lines = lines
        self._axes = axes
        self._opening = False
        draw = cell.random
        # how often a line is faulty still
        self._faulty = {
            draw.randint(1, lines): draw.randint(1, 2) for _ in range(draw.choice([0, 0, 1, 2, 3]))
        }
        self.forget()

    def forget(self) -> None:
        """The server has gone: begins again."""
        self._program, self._accepted, self._rejections, self._opening = "", 0, 0, False
        self._given: dict[int, str] = {}
        # what was said to be accepted
        self._accepted_texts: dict[int, str] = {}

    def work(self) -> None:
        """Does the next thing, and comes back for more."""
        if not self.done:
            if self._program:
                self._send()
            elif not self._opening:
                self._opening = True
                self._cell.begin(self._open())
            self._cell.later(self.work)

    def accepted_text(self, program: str, number: int) -> str | None:
        """The text that it takes for accepted."""
        return self._accepted_texts.get(number) if program == self._program else None

    def on_ack(self, ack: Ack) -> None:
        if ack.program != self._program:
            return
        if ack.rejections > self._rejections:
            self._hear_rejection(ack.rejections, ack.rejected)
        self._take(ack.program, ack.rejections, ack.accepted)
        if ack.state in ENDED:
            if ack.state == "finished":
                self._cell.agree(self._program, {n: self._text(n) for n in range(1, self._lines + 1)})
                self.done = True
            self.forget()

    async def _open(self) -> None:
        try:
            program = await self._cell.service.open(
                self.name, ProgramOptions(axes=self._axes, on_disconnect="finish")
            )
            self.forget()
            self._program = program.program
        except ServiceError:
            pass
        self._opening = False

    def _text(self, number: int) -> str:
        if number not in self._given:
            kind = "bad" if self._faulty.get(number, 0) else "move"
            self._given[number] = f"{kind} {self._program}:{number} after {self._rejections}"
        return self._given[number]

    def _take(self, program: str, rejections: int, accepted: int) -> None:
        """Takes numbers, unless they are of another count of rejections, or old."""
        if program != self._program or rejections != self._rejections or accepted <= self._accepted:
            return
        taken = {number: self._given.get(number, "") for number in range(self._accepted + 1, accepted + 1)}
        require(all(taken.values()), f"{program}: lines through {accepted} are accepted, {taken} was given")
        self._accepted_texts |= taken
        self._accepted = accepted
        self._cell.agree(program, {n: text for n, text in taken.items() if n in self._cell.texts[program]})

    def _hear_rejection(self, rejections: int, line: int) -> None:
        given = self._given.get(line, "")
        require(given.startswith("bad"), f"line {line}, {given!r}, is said to be rejected")
        require(rejections == self._rejections + 1, f"{rejections} rejections after {self._rejections}")
        self._rejections = rejections
        self._faulty[line] -= 1
        self._accepted = min(self._accepted, line - 1)
        for number in [each for each in self._given if each >= line]:
            del self._given[number]
            self._accepted_texts.pop(number, None)

    def _send(self) -> None:
        """Gives a message to the network: lines, the close or a question."""
        draw, program, rejections = self._cell.random, self._program, self._rejections
        if draw.random() < 0.2:
            # as one that has heard nothing for a while
            self._cell.network(partial(self._ask, program))
        if self._accepted >= self._lines:
            self._cell.network(partial(self._close, program))
            return
        first = max(1, self._accepted + 1 - draw.choice([0, 0, 0, 1, 3]) + draw.choice([0, 0, 0, 2]))
        last = min(self._lines, first + draw.randint(0, 6))
        lines = [self._text(number) for number in range(first, last + 1)]
        if lines:
            put = draw.random() < 0.5
            self._cell.network(partial(self._put if put else self._submit, program, first, lines, rejections))

    # what happens where its messages arrive

    def _put(self, program: str, first: int, lines: list[str], rejections: int) -> None:
        self._cell.service.lines.stream(program, first, lines, rejections)

    def _submit(self, program: str, first: int, lines: list[str], rejections: int) -> None:
        async def answer() -> None:
            try:
                taken = await self._cell.service.lines.submit(self.name, program, first, lines, rejections)
            except (RejectedLines, Refused) as error:
                self._cell.network(partial(self._on_refusal, program, error))
            except ServiceError:
                return
            else:
                self._cell.said.hear("submit", program, taken.done, taken.state)
                self._cell.network(partial(self._take, program, taken.epoch, taken.journaled))

        self._cell.begin(answer())

    def _on_refusal(self, program: str, error: RejectedLines | Refused) -> None:
        if program != self._program:
            return
        if error.code == "MC503":
            self.forget()
            return
        rejections = int(str(error.details.get("rejections", 0)))
        if isinstance(error, RejectedLines) and rejections > self._rejections:
            self._hear_rejection(rejections, int(str(error.details["expected"])))
        self._take(program, rejections, int(str(error.details.get("accepted", 0))))

    def _close(self, program: str) -> None:
        async def answer() -> None:
            with suppress(ServiceError):
                closed = await self._cell.service.lines.close(self.name, program, last=self._lines)
                self._cell.said.hear("close", program, closed.done, closed.state)

        self._cell.begin(answer())

    def _ask(self, program: str) -> None:
        try:
            # made now, and late too
            answer = self._cell.service.program(program).ack()
        except ServiceError:
            self._cell.network(partial(self._on_unknown, program))
        else:
            self._cell.network(partial(self.on_ack, answer))

    def _on_unknown(self, program: str) -> None:
        if program == self._program:
            self.forget()
