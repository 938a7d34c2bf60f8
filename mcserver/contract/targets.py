"""What a client's servo mode has to get right, as scripted exchanges: targets out, acknowledgements in.

The counts are those of the service's own filter of targets.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np

from mcserver.contract.script import error_message, program_of, scripted, shown_message
from mcserver.errors import Refused
from mcserver.machine.machine_file import load_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.net.servo_messages import Frame, ServoReply, StreamTargets
from mcserver.net.servo_methods import targets_in_si
from mcserver.service.reports import ProgramState
from mcserver.service.target_stream import Now, TargetStream

PROGRAM = "b4c1-1"
PERIOD_S = 0.01
COUNTED = ("taken", "lost", "doubled", "reordered", "late", "jumped", "refused", "clipped", "slowed")
Rows = Sequence[Sequence[float]]


def target_sequences() -> list[dict[str, Any]]:
    """Return all of them, in the order in which one reads them."""
    made = (
        _targets(),
        _chunk(),
        _tool(),
        _loss(),
        _refused(),
        _refused_targets(),
        _end(),
        _silence(),
        _unanswered(),
        _stood_still(),
    )
    return [script.sequence() for script in made]


class TargetScript:
    """Notes the steps of one sequence.

    Args:
        name: of the sequence, which is its file's name too. why: what a client has to get right.
        opened: the server lets the axes follow. built_in: whose first axes follow.
    """

    def __init__(
        self, name: str, why: str, *, opened: bool = True, built_in: str = "cartesian", axes: int = 2
    ) -> None:
        self._head = {"name": name, "why": why}
        self._steps: list[dict[str, Any]] = []
        self._seq = 0
        self._sent = 83.412
        self.program = program_of(PROGRAM, 1, 100)
        machine = load_machine(built_in)
        followed = machine.axes[:axes]
        self._setpoint = np.array([axis.initial_position for axis in followed])
        self.program.targets = TargetStream(followed, machine.cycle_s, build_kinematics(machine))
        if opened:
            self._note("servo", shown_message(ServoReply(PROGRAM, list(range(axes)))))

    def sequence(self) -> dict[str, Any]:
        return {**self._head, "steps": self._steps}

    def give(
        self,
        positions: Rows | None = None,
        velocities: Rows | None = None,
        times: Sequence[float] | None = None,
        *,
        counts_s: float = 0.1,
        tool: int | None = None,
        frame: Frame = "base",
        lost: bool = False,
        fails: tuple[str, str] | None = None,
    ) -> None:
        """The application gives targets, and the client puts them.

        Args:
            lost: they do not arrive. fails: code and words of the failure after the program's end: nothing is
                put.
        """
        fields = (positions, velocities, times, tool, frame)
        names = ("positions", "velocities", "times", "tool", "frame")
        given = {"sent": self._sent, "counts_s": counts_s, **dict(zip(names, fields, strict=True))}
        self._note("targets", given)
        if fails is not None:
            self._note("fails", {"code": fails[0], "says": fails[1]})
            return
        self._seq += 1
        payload = [self._seq, self._sent, counts_s, *fields]
        self._note("puts", payload)
        if lost:
            self._note("lost", "the message")
        else:
            message = msgspec.convert(payload, StreamTargets)
            assert self.program.targets is not None
            taken = targets_in_si(self.program, message)
            self.program.targets.take(taken, Now(self._sent, self._setpoint))
        self._sent = round(self._sent + PERIOD_S, 3)

    def passes(self, seconds: float) -> None:
        """Time passes."""
        self._sent = round(self._sent + seconds, 3)

    def refuses(self, refusal: Refused) -> None:
        """The server does not let the axes follow."""
        self._steps.append(error_message(refusal))
        self._note("fails", {"code": refusal.code, "says": refusal.message})

    def ends(self, state: ProgramState, reason: str = "") -> None:
        """The program ends, or is running; the acknowledgement says how."""
        self.program.reason = reason
        self.program.state = state
        self._note("ack", shown_message(self.program.ack()))
        self._note("knows", {"state": state})

    def asked(self) -> None:
        """The client asks `programs`, and shows what the server has counted."""
        status = self.program.status()
        assert status.servo is not None
        self._note("asked", shown_message(status))
        self._note("counts", {name: getattr(status.servo, name) for name in COUNTED})

    def _note(self, what: str, value: object) -> None:
        self._steps.append({what: value})


@scripted(TargetScript, "messages are numbered from 1")
def _targets(script: TargetScript) -> None:
    script.give([[12.5, 3.0]])
    script.give([[12.9, 3.0]], [[40.0, 0.0]])
    script.give(None, [[-0.5, 1e-9]], counts_s=0.25)
    script.asked()


@scripted(TargetScript, "points with times go as one message, which replaces the one before")
def _chunk(script: TargetScript) -> None:
    times = [0.0, 0.02, 0.04]
    script.give([[0.0, 0.0], [0.1, 0.2], [0.2, 0.4]], None, times)
    script.give([[0.1, 0.2], [0.2, 0.4], [0.3, 0.5]], [[5.0, 10.0], [5.0, 7.5], [0.0, 0.0]], times)
    script.asked()


@scripted(TargetScript, "a tool's poses and twists go as positions and velocities", built_in="arm6", axes=6)
def _tool(script: TargetScript) -> None:
    start = [460.0, 0.0, 675.0, 0.0, 0.0, 0.0]
    script.give([start], tool=1)
    script.give([start], [[0.0, 50.0, 0.0, 0.0, 0.0, 10.0]], tool=1)
    script.give(None, [[0.0, 0.0, -20.0, 0.0, 0.0, 0.0]], tool=1, frame="tool")
    script.give([start], tool=2)
    script.asked()


@scripted(TargetScript, "nothing is sent again: the next message is newer, and the server counts")
def _loss(script: TargetScript) -> None:
    script.give([[1.0, 1.0]])
    script.give([[1.1, 1.0]], lost=True)
    script.give([[1.2, 1.0]], lost=True)
    script.give([[1.3, 1.0]])
    script.asked()


@scripted(TargetScript, "servo mode that is refused is an error, and there is no program", opened=False)
def _refused(script: TargetScript) -> None:
    script.refuses(
        Refused(
            "MC512", "axis 1 is leased by part 7 of mill", "wait until it has ended", axis=1, client="mill"
        )
    )


@scripted(TargetScript, "targets that do not fit the axes are counted; the rest goes on")
def _refused_targets(script: TargetScript) -> None:
    script.give([[1.0, 1.0]])
    script.give([[1.0, 1.0, 1.0]])
    script.give([[1.0, 1.0]], None, [0.01, 0.02])
    script.give([[1.0, 1.1]])
    script.asked()


@scripted(TargetScript, "once closed and arrived the program has finished, and takes no targets")
def _end(script: TargetScript) -> None:
    script.give([[2.0, 2.0]])
    script.ends("finished")
    script.give([[3.0, 3.0]], fails=("MC536", ""))


@scripted(
    TargetScript,
    "targets that no acknowledgement answers for as long as they count, and 0.5 s, fail; the next word"
    " of the server ends that",
)
def _unanswered(script: TargetScript) -> None:
    script.give([[2.0, 2.0]])
    script.ends("running")
    # one that was answered counts however long
    script.passes(5.0)
    script.give([[2.1, 2.0]], counts_s=0.3, lost=True)
    script.passes(0.7)
    script.give([[2.2, 2.0]], counts_s=0.3, lost=True)
    script.passes(0.2)
    script.give([[2.3, 2.0]], fails=("MC530", ""))
    script.ends("running")
    script.give([[2.4, 2.0]])


@scripted(
    TargetScript,
    "a sender that stood still (in a debugger, say) has not listened meanwhile: it hears"
    " what has become of its targets, not that the server was silent",
)
def _stood_still(script: TargetScript) -> None:
    script.give([[2.0, 2.0]])
    script.passes(5.0)
    script.give([[2.1, 2.0]])
    script.passes(0.01)
    script.give([[2.2, 2.0]])
    script.ends("aborted", "MC465: no targets came in time")
    script.give([[2.3, 2.0]], fails=("MC535", "(MC465: no targets came in time)"))


@scripted(TargetScript, "a program that was stopped, as for want of targets, says so at the next ones")
def _silence(script: TargetScript) -> None:
    script.give([[2.0, 2.0]])
    script.ends("aborted", "MC465: no targets came in time")
    script.give([[3.0, 3.0]], fails=("MC535", "(MC465: no targets came in time)"))
