"""What a client's streaming core has to get right, as scripted exchanges (docs/wire/lines.md)."""

from __future__ import annotations

from typing import Any

from mcserver.contract.faulty_lines import faulty_lines
from mcserver.contract.script import Script, lines, scripted
from mcserver.service.reports import Fault


def sequences() -> list[dict[str, Any]]:
    """Return all of them, in the order in which one reads them."""
    made = (
        _numbering(),
        _start_line(),
        _chunks(),
        _credit(),
        _no_credit_at_first(),
        _taken_in_part(),
        _answer_lost(),
        _message_lost(),
        _lost_in_part(),
        _gap(),
        _gap_answered_once(),
        _old_acknowledgement(),
        _foreign_numbers(),
        *faulty_lines(),
        _close_and_finish(),
        _behind_the_end(),
        _aborted(),
        _faulted(),
        _held_and_paused(),
        _restart(),
        _continuation(),
        _whole_continuation(),
    )
    return [script.sequence() for script in made]


@scripted(Script, "lines are numbered from 1 and sent in order")
def _numbering(script: Script) -> None:
    script.give("G1010", "G01 X10 F600", "", "(Fräse ß€𝄞)", "G01 X0")
    script.exchange(1, 5)
    script.settled()
    script.runs(3)
    script.knows()
    script.give("G01 X1")
    script.exchange(6, 6)
    script.knows()


@scripted(Script, "the first number is that which the reply to `open` expects", start_line=120)
def _start_line(script: Script) -> None:
    script.knows()
    script.give(*lines(2))
    script.exchange(120, 121)
    script.knows()


@scripted(Script, "no message holds more lines than it may", chunk_lines=3)
def _chunks(script: Script) -> None:
    script.give(*lines(7))
    script.exchange(1, 3)
    script.exchange(4, 6)
    script.exchange(7, 7)
    script.settled()


@scripted(Script, "never more than `credit` lines beyond `accepted`", room=4)
def _credit(script: Script) -> None:
    script.give(*lines(9))
    script.exchange(1, 4)
    script.quiet()
    script.runs(1)
    script.exchange(5, 5)
    script.quiet()
    script.runs(5)
    script.exchange(6, 9)
    script.settled()


@scripted(Script, "a credit of 0 means that the client waits", room=0)
def _no_credit_at_first(script: Script) -> None:
    script.give(*lines(2))
    script.quiet()
    script.program.queue = type(script.program.queue)(1, limit_lines=10)
    script.ack()
    script.exchange(1, 2)
    script.knows()


@scripted(Script, "of a message that is longer than the credit its beginning is taken")
def _taken_in_part(script: Script) -> None:
    script.give(*lines(6))
    script.sends(1, 6)
    # by now less fits than the reply to `open` has said
    script.program.queue = type(script.program.queue)(1, limit_lines=4)
    script.answer()
    script.settled()
    script.runs(3)
    # who does not wait for replies cannot know whether line 5 is on its way still
    script.asked()
    script.exchange(5, 6)
    script.knows()


@scripted(Script, "lines that were taken are not sent again once the client has asked")
def _answer_lost(script: Script) -> None:
    script.give(*lines(3))
    script.sends(1, 3)
    script.answer_lost()
    script.asked()
    script.settled()


@scripted(Script, "lines that were not taken are sent again, under their numbers")
def _message_lost(script: Script) -> None:
    script.give(*lines(3))
    script.sends(1, 3)
    script.message_lost()
    script.asked()
    script.exchange(1, 3)
    script.settled()


@scripted(Script, "of two messages the second is lost: it alone is sent again", chunk_lines=2)
def _lost_in_part(script: Script) -> None:
    script.give(*lines(4))
    script.exchange(1, 2)
    script.sends(3, 4)
    script.message_lost()
    script.asked()
    script.exchange(3, 4)
    script.knows()


@scripted(
    Script,
    "a message is lost and the next one arrives: the client goes back to the number expected",
    chunk_lines=2,
    puts_only=True,
)
def _gap(script: Script) -> None:
    script.give(*lines(4))
    script.sends(1, 2)
    script.message_lost()
    script.exchange(3, 4)
    script.exchange(1, 2)
    script.exchange(3, 4)
    script.settled()


@scripted(
    Script, "each message behind a gap is answered; going back once is enough", chunk_lines=2, puts_only=True
)
def _gap_answered_once(script: Script) -> None:
    script.give(*lines(6))
    script.sends(1, 2)
    script.message_lost()
    script.sends(3, 4)
    script.exchange(5, 6)
    script.sends(1, 2)
    script.sends(3, 4)
    script.sends(5, 6)
    # the second message behind the gap
    script.answer()
    script.quiet()
    script.answer()
    script.answer()
    script.answer()
    script.settled()


@scripted(Script, "one that is older than what is known changes nothing", chunk_lines=3)
def _old_acknowledgement(script: Script) -> None:
    script.give(*lines(6))
    script.exchange(1, 3)
    late = script.keep_ack()
    script.exchange(4, 6)
    script.late_ack(late)
    script.settled()


@scripted(Script, "lines that were never given cannot have been accepted")
def _foreign_numbers(script: Script) -> None:
    script.give(*lines(2))
    script.sends(1, 2)
    script.foreign_ack(50, 100)
    script.answer()
    script.settled()
    script.give("G01 X3")
    script.exchange(3, 3)
    script.knows()


@scripted(Script, "a program is closed behind its last line and ends once all have run")
def _close_and_finish(script: Script) -> None:
    script.give(*lines(3))
    script.exchange(1, 3)
    script.closes(3)
    script.runs(2)
    script.knows()
    script.ends("finished")
    script.knows()


@scripted(Script, "lines behind M02 are refused once the program has ended", chunk_lines=2)
def _behind_the_end(script: Script) -> None:
    script.give("G01 X1", "M02", "G01 X2")
    script.exchange(1, 2)
    script.sends(3, 3)
    script.ends("finished")
    script.answer()
    script.fails("MC536")
    script.knows()


@scripted(Script, "an abort is raised to the application with its reason; nothing more is sent", room=2)
def _aborted(script: Script) -> None:
    script.give(*lines(5))
    script.exchange(1, 2)
    script.enters("ending")
    script.ends("aborted", reason="aborted by ann")
    script.fails("MC535", says="(aborted by ann)")
    script.settled()


@scripted(Script, "a fault of the machine is raised with its code")
def _faulted(script: Script) -> None:
    script.give(*lines(2))
    script.exchange(1, 2)
    script.runs(1)
    script.ends("faulted", Fault("MC401", "axis 2 has a following error", axis=2, line=2, t=4.5))
    script.fails("MC401")
    script.settled()


@scripted(Script, "states come and go; lines are taken all the same", chunk_lines=1)
def _held_and_paused(script: Script) -> None:
    script.give(*lines(2))
    script.exchange(1, 1)
    script.enters("held")
    script.knows()
    script.exchange(2, 2)
    script.enters("paused")
    script.knows()
    script.enters("running")
    script.knows()


@scripted(Script, "a server that was restarted knows no such program: it was interrupted", room=3)
def _restart(script: Script) -> None:
    script.give(*lines(5))
    script.exchange(1, 3)
    script.runs(2)
    script.sends(4, 5)
    script.message_lost()
    script.asked_after_restart()
    script.fails("MC534")
    script.quiet()
    script.program.state = "interrupted"
    script.knows()


@scripted(Script, "lines that the server had are not sent again, and are not done either")
def _continuation(script: Script) -> None:
    script.give(*lines(5))
    script.exchange(1, 5)
    script.runs(3)
    script.asked_after_restart()
    script.fails("MC534")
    script.continues(4)
    script.settled()
    script.give("G01 X6", "G01 X7")
    script.exchange(6, 7)
    script.runs(5)
    script.knows()
    script.closes(7)
    script.ends("finished")
    script.knows()


@scripted(Script, "where the server had the whole text, it runs to its end by itself")
def _whole_continuation(script: Script) -> None:
    script.give(*lines(5))
    script.exchange(1, 5)
    script.closes(5)
    script.runs(3)
    script.asked_after_restart()
    script.fails("MC534")
    script.continues(4, whole=True)
    script.settled()
    script.runs(4)
    script.ends("finished")
    script.settled()
