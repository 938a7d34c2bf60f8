"""What a client's streaming core has to get right, as scripted exchanges (docs/wire/lines.md)."""

from __future__ import annotations

from typing import Any

from mcserver.contract.script import Script, lines
from mcserver.errors import Diagnostic
from mcserver.service.reports import Fault, wire_diagnostic

FAULTY = Diagnostic("MC101", "an unknown code", line=2, column=5, end_column=8, hint="did you mean G01?")


def sequences() -> list[dict[str, Any]]:
    """All of them, in the order in which one reads them."""
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
        _faulty_line(),
        _faulty_line_again(),
        _faulty_with_lines_under_way(),
        _rejection_heard_late(),
        _crossing_acknowledgements(),
        _rejected_twice(),
        _rejected_under_way(),
        _verdict(),
        _verdict_twice(),
        _rejected_at_the_end(),
        _close_and_finish(),
        _behind_the_end(),
        _aborted(),
        _faulted(),
        _held_and_paused(),
        _restart(),
        _resume(),
    )
    return [script.sequence() for script in made]


def _numbering() -> Script:
    script = Script("numbering", "lines are numbered from 1 and sent in order")
    script.give("G1010", "G01 X10 F600", "", "(Fräse ß€𝄞)", "G01 X0")
    script.exchange(1, 5)
    script.settled()
    script.runs(3)
    script.knows()
    script.give("G01 X1")
    script.exchange(6, 6)
    script.knows()
    return script


def _start_line() -> Script:
    script = Script(
        "start line", "the first number is that which the reply to `open` expects", start_line=120
    )
    script.knows()
    script.give(*lines(2))
    script.exchange(120, 121)
    script.knows()
    return script


def _chunks() -> Script:
    script = Script("chunks", "no message holds more lines than it may", chunk_lines=3)
    script.give(*lines(7))
    script.exchange(1, 3)
    script.exchange(4, 6)
    script.exchange(7, 7)
    script.settled()
    return script


def _credit() -> Script:
    script = Script("credit", "never more than `credit` lines beyond `accepted`", room=4)
    script.give(*lines(9))
    script.exchange(1, 4)
    script.quiet()
    script.runs(1)
    script.exchange(5, 5)
    script.quiet()
    script.runs(5)
    script.exchange(6, 9)
    script.settled()
    return script


def _no_credit_at_first() -> Script:
    script = Script("no credit at first", "a credit of 0 means that the client waits", room=0)
    script.give(*lines(2))
    script.quiet()
    script.program.queue = type(script.program.queue)(1, limit_lines=10)
    script.ack()
    script.exchange(1, 2)
    script.knows()
    return script


def _taken_in_part() -> Script:
    script = Script("taken in part", "of a message that is longer than the credit its beginning is taken")
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
    return script


def _answer_lost() -> Script:
    script = Script("answer lost", "lines that were taken are not sent again once the client has asked")
    script.give(*lines(3))
    script.sends(1, 3)
    script.answer_lost()
    script.asked()
    script.settled()
    return script


def _message_lost() -> Script:
    script = Script("message lost", "lines that were not taken are sent again, under their numbers")
    script.give(*lines(3))
    script.sends(1, 3)
    script.message_lost()
    script.asked()
    script.exchange(1, 3)
    script.settled()
    return script


def _lost_in_part() -> Script:
    script = Script(
        "lost in part", "of two messages the second is lost: it alone is sent again", chunk_lines=2
    )
    script.give(*lines(4))
    script.exchange(1, 2)
    script.sends(3, 4)
    script.message_lost()
    script.asked()
    script.exchange(3, 4)
    script.knows()
    return script


def _gap() -> Script:
    script = Script(
        "gap",
        "a message is lost and the next one arrives: the client goes back to the number expected",
        chunk_lines=2,
        puts_only=True,
    )
    script.give(*lines(4))
    script.sends(1, 2)
    script.message_lost()
    script.exchange(3, 4)
    script.exchange(1, 2)
    script.exchange(3, 4)
    script.settled()
    return script


def _gap_answered_once() -> Script:
    script = Script(
        "gap answered once",
        "each message behind a gap is answered; going back once is enough",
        chunk_lines=2,
        puts_only=True,
    )
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
    return script


def _old_acknowledgement() -> Script:
    script = Script(
        "old acknowledgement", "one that is older than what is known changes nothing", chunk_lines=3
    )
    script.give(*lines(6))
    script.exchange(1, 3)
    late = script.keep_ack()
    script.exchange(4, 6)
    script.late_ack(late)
    script.settled()
    return script


def _foreign_numbers() -> Script:
    script = Script("foreign numbers", "lines that were never given cannot have been accepted")
    script.give(*lines(2))
    script.sends(1, 2)
    script.foreign_ack(50, 100)
    script.answer()
    script.settled()
    script.give("G01 X3")
    script.exchange(3, 3)
    script.knows()
    return script


def _faulty_line() -> Script:
    script = Script(
        "faulty line", "`accepted` steps back before the faulty line, which is reported with its place"
    )
    script.give("G1010", "G91 GO1", "G01 X2", "G01 X3")
    script.exchange(1, 4)
    script.rejects(2, FAULTY)
    script.fails("MC101", line=2, column=5)
    script.settled()
    return script


def _faulty_line_again() -> Script:
    script = Script("faulty line again", "the program lives on: the corrected line has the same number")
    script.give("G1010", "G91 GO1", "G01 X2")
    script.exchange(1, 3)
    script.rejects(2, FAULTY)
    script.fails("MC101", line=2, column=5)
    script.asked()
    script.give("G91 G01", "G01 X2")
    script.exchange(2, 3)
    script.knows()
    script.runs(3)
    script.knows()
    return script


def _faulty_with_lines_under_way() -> Script:
    script = Script(
        "faulty with lines under way",
        "what was sent behind a faulty line is a gap, and is not sent again",
        chunk_lines=3,
    )
    script.give("G1010", "G91 GO1", "G01 X2", "G01 X3", "G01 X4")
    script.exchange(1, 3)
    script.sends(4, 5)
    script.rejects(2, FAULTY)
    script.fails("MC101", line=2, column=5)
    script.answer()
    script.settled()
    return script


def _rejection_heard_late() -> Script:
    script = Script(
        "rejection heard late",
        "lines that were given in ignorance of a rejection are given up with it, whatever their numbers",
    )
    script.give("G1010", "G91 GO1", "G01 X2")
    script.sends(1, 3)
    script.answer()
    script.rejects_unheard(2, FAULTY)
    script.give("G01 X3", "G01 X4")
    script.sends(4, 5)
    script.answer()
    # who has called asks why it was refused
    script.asked()
    script.fails("MC101", line=2, column=5)
    script.quiet()
    script.knows()
    script.give("G91 G01", "G01 X2")
    script.sends(2, 3)
    script.answer()
    script.runs(3)
    script.knows()
    return script


def _crossing_acknowledgements() -> Script:
    script = Script(
        "crossing acknowledgements",
        "an acknowledgement from before the corrected line came, or from before the rejection, says nothing"
        " of it: its count of rejections is no greater than the one known",
    )
    script.give("G1010", "G91 GO1", "G01 X2")
    script.sends(1, 3)
    script.answer()
    before = script.keep_ack()
    script.rejects(2, FAULTY)
    rejected = script.keep_ack()
    script.fails("MC101", line=2, column=5)
    script.asked()
    script.give("G91 G01", "G01 X2", "G01 X3")
    script.sends(2, 4)
    # line 1 has ended: made before the server took the corrected line
    script.runs(1)
    script.knows()
    # lines 1 to 3 were accepted, of which 2 and 3 have been given up since
    script.late_ack(before)
    script.quiet()
    script.knows()
    script.answer()
    script.late_ack(rejected)
    script.late_ack(before)
    script.quiet()
    script.knows()
    script.runs(4)
    script.knows()
    return script


def _rejected_twice() -> Script:
    script = Script("rejected twice", "a rejection of the corrected line is heard, and is another one")
    script.give("G1010", "G91 GO1", "G01 X2")
    script.sends(1, 3)
    script.answer()
    script.rejects(2, FAULTY)
    first = script.keep_ack()
    script.fails("MC101", line=2, column=5)
    script.asked()
    script.give("G91 G02", "G01 X2")
    script.sends(2, 3)
    script.answer()
    script.rejects(2, FAULTY)
    script.fails("MC101", line=2, column=5)
    script.late_ack(first)
    script.asked()
    script.quiet()
    script.knows()
    script.give("G91 G01", "G01 X2")
    script.sends(2, 3)
    script.late_ack(first)
    script.answer()
    script.knows()
    script.runs(3)
    script.knows()
    return script


def _rejected_under_way() -> Script:
    script = Script(
        "rejected under way",
        "a rejection that is said by an acknowledgement and by the answer as well is one",
    )
    script.give("G1010")
    script.sends(1, 1)
    script.answer()
    script.give("G91 GO1", "G01 X2")
    script.sends(2, 3)
    script.rejects_and_says_so(2, FAULTY)
    script.fails("MC101", line=2, column=5)
    script.quiet()
    script.knows()
    script.asked()
    script.give("G91 G01", "G01 X2")
    script.sends(2, 3)
    script.answer()
    script.knows()
    script.runs(3)
    script.knows()
    return script


def _verdict_twice() -> Script:
    script = Script(
        "verdict twice",
        "the corrected line is judged by its own answer, not by what is said of the first one",
    )
    script.judge("G1010")
    script.sends(1, 1)
    script.answer()
    script.judge("G91 GO1")
    script.sends(2, 2)
    script.rejects_at_once(2, FAULTY)
    rejected = script.keep_ack()
    script.fails("MC101", line=2, column=5)
    script.late_ack(rejected)
    script.judge("G91 G02")
    script.sends(2, 2)
    script.runs(1)
    script.rejects_at_once(2, FAULTY)
    script.fails("MC101", line=2, column=5)
    script.judge("G91 G01")
    script.sends(2, 2)
    script.late_ack(rejected)
    script.answer()
    script.knows()
    return script


def _verdict() -> Script:
    script = Script(
        "verdict", "a single line is judged before the call returns; a faulty one may be sent again"
    )
    script.judge("G1010")
    script.exchange(1, 1)
    script.knows()
    script.judge("G91 GO1")
    script.sends(2, 2)
    script.rejects_at_once(2, FAULTY)
    script.fails("MC101", line=2, column=5)
    script.knows()
    script.judge("G91 G01")
    script.exchange(2, 2)
    script.knows()
    return script


def _rejected_at_the_end() -> Script:
    script = Script("rejected at the end", "a closed program ends at a faulty line")
    script.give("G1010", "G91 GO1")
    script.exchange(1, 2)
    script.closes(2)
    script.program.reject(2, [])
    script.program.diagnostics = [wire_diagnostic(FAULTY)]
    script.ends("rejected")
    script.fails("MC101", line=2, column=5)
    script.knows()
    return script


def _close_and_finish() -> Script:
    script = Script("close and finish", "a program is closed behind its last line and ends once all have run")
    script.give(*lines(3))
    script.exchange(1, 3)
    script.closes(3)
    script.runs(2)
    script.knows()
    script.ends("finished")
    script.knows()
    return script


def _behind_the_end() -> Script:
    script = Script(
        "behind the end", "lines behind M02 are refused once the program has ended", chunk_lines=2
    )
    script.give("G01 X1", "M02", "G01 X2")
    script.exchange(1, 2)
    script.sends(3, 3)
    script.ends("finished")
    script.answer()
    script.fails("MC536")
    script.knows()
    return script


def _aborted() -> Script:
    script = Script(
        "aborted", "an operator's abort is raised to the application; nothing more is sent", room=2
    )
    script.give(*lines(5))
    script.exchange(1, 2)
    script.enters("ending")
    script.ends("aborted")
    script.fails("MC535")
    script.settled()
    return script


def _faulted() -> Script:
    script = Script("faulted", "a fault of the machine is raised with its code")
    script.give(*lines(2))
    script.exchange(1, 2)
    script.runs(1)
    script.ends("faulted", Fault("MC401", "axis 2 has a following error", axis=2, line=2, t=4.5))
    script.fails("MC401")
    script.settled()
    return script


def _held_and_paused() -> Script:
    script = Script("held and paused", "states come and go; lines are taken all the same", chunk_lines=1)
    script.give(*lines(2))
    script.exchange(1, 1)
    script.enters("held")
    script.knows()
    script.exchange(2, 2)
    script.enters("paused")
    script.knows()
    script.enters("running")
    script.knows()
    return script


def _restart() -> Script:
    script = Script(
        "restart", "a server that was restarted knows no such program: it was interrupted", room=3
    )
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
    return script


def _resume() -> Script:
    script = Script("resume", "another program goes on where an interrupted one had ended")
    script.give(*lines(5))
    script.exchange(1, 5)
    script.runs(3)
    script.asked_after_restart()
    script.fails("MC534")
    script.resumes(4)
    script.knows()
    script.give("G01 X4", "G01 X5")
    script.exchange(4, 5)
    script.closes(5)
    script.ends("finished")
    script.knows()
    return script
