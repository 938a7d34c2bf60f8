"""Sequences of the contract in which the server finds a line faulty."""

from __future__ import annotations

from mcserver.contract.script import Script, scripted
from mcserver.errors import Diagnostic
from mcserver.service.reports import wire_diagnostic

FAULTY = Diagnostic("MC101", "an unknown code", line=2, column=5, end_column=8, hint="did you mean G01?")


def faulty_lines() -> tuple[Script, ...]:
    """Return all of them, in the order in which one reads them."""
    return (
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
    )


@scripted(Script, "`accepted` steps back before the faulty line, which is reported with its place")
def _faulty_line(script: Script) -> None:
    script.give("G1010", "G91 GO1", "G01 X2", "G01 X3")
    script.exchange(1, 4)
    script.rejects(2, FAULTY)
    script.fails("MC101", line=2, column=5)
    script.settled()


@scripted(Script, "the program lives on: the corrected line has the same number")
def _faulty_line_again(script: Script) -> None:
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


@scripted(Script, "what was sent behind a faulty line is a gap, and is not sent again", chunk_lines=3)
def _faulty_with_lines_under_way(script: Script) -> None:
    script.give("G1010", "G91 GO1", "G01 X2", "G01 X3", "G01 X4")
    script.exchange(1, 3)
    script.sends(4, 5)
    script.rejects(2, FAULTY)
    script.fails("MC101", line=2, column=5)
    script.answer()
    script.settled()


@scripted(
    Script, "lines that were given in ignorance of a rejection are given up with it, whatever their numbers"
)
def _rejection_heard_late(script: Script) -> None:
    script.give("G1010", "G91 GO1", "G01 X2")
    script.exchange(1, 3)
    script.rejects_unheard(2, FAULTY)
    script.give("G01 X3", "G01 X4")
    script.exchange(4, 5)
    # who has called asks why it was refused
    script.asked()
    script.fails("MC101", line=2, column=5)
    script.quiet()
    script.knows()
    script.give("G91 G01", "G01 X2")
    script.exchange(2, 3)
    script.runs(3)
    script.knows()


@scripted(
    Script,
    "an acknowledgement from before the corrected line came, or from before the rejection, says nothing"
    " of it: its count of rejections is no greater than the one known",
)
def _crossing_acknowledgements(script: Script) -> None:
    script.give("G1010", "G91 GO1", "G01 X2")
    script.exchange(1, 3)
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


@scripted(Script, "a rejection of the corrected line is heard, and is another one")
def _rejected_twice(script: Script) -> None:
    script.give("G1010", "G91 GO1", "G01 X2")
    script.exchange(1, 3)
    script.rejects(2, FAULTY)
    first = script.keep_ack()
    script.fails("MC101", line=2, column=5)
    script.asked()
    script.give("G91 G02", "G01 X2")
    script.exchange(2, 3)
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


@scripted(Script, "a rejection that is said by an acknowledgement and by the answer as well is one")
def _rejected_under_way(script: Script) -> None:
    script.give("G1010")
    script.exchange(1, 1)
    script.give("G91 GO1", "G01 X2")
    script.sends(2, 3)
    script.rejects_and_says_so(2, FAULTY)
    script.fails("MC101", line=2, column=5)
    script.quiet()
    script.knows()
    script.asked()
    script.give("G91 G01", "G01 X2")
    script.exchange(2, 3)
    script.knows()
    script.runs(3)
    script.knows()


@scripted(Script, "the corrected line is judged by its own answer, not by what is said of the first one")
def _verdict_twice(script: Script) -> None:
    script.judge("G1010")
    script.exchange(1, 1)
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


@scripted(Script, "a single line is judged before the call returns; a faulty one may be sent again")
def _verdict(script: Script) -> None:
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


@scripted(Script, "a closed program ends at a faulty line")
def _rejected_at_the_end(script: Script) -> None:
    script.give("G1010", "G91 GO1")
    script.exchange(1, 2)
    script.closes(2)
    script.program.reject(2, [])
    script.program.diagnostics = [wire_diagnostic(FAULTY)]
    script.ends("rejected")
    script.fails("MC101", line=2, column=5)
    script.knows()
