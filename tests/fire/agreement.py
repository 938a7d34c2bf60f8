"""What a client was answered, what the journal holds and where the axis is have to agree."""

from __future__ import annotations

import contextlib
import sqlite3
from pathlib import Path

import msgspec

from tests.fire.client import HEAD, STEP_MM

# of a simulated axis in position [mm]
TOLERANCE_MM = 0.02


class Journaled(msgspec.Struct, frozen=True):
    """A program as the journal has it.

    Attributes:
        accepted: last line. gaps: lines miss or overlap.
    """

    state: str | None
    accepted: int
    gaps: bool
    started: int
    done: int


def read_journal(path: Path, program: str) -> Journaled:
    with contextlib.closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as connection:
        row = connection.execute(
            "SELECT state, started, done FROM programs WHERE program=?", (program,)
        ).fetchone()
        # a server that was killed before it was written: nothing of it was accepted
        state, started, done = row or (None, 0, 0)
        chunks = connection.execute(
            "SELECT first, last FROM chunks WHERE program=? ORDER BY id", (program,)
        ).fetchall()
    expected, gaps = 1, False
    for first, last in chunks:
        gaps |= first != expected
        expected = last + 1
    return Journaled(state, expected - 1, gaps, started, done)


def disagreement(said: dict[str, object], lines: int, kept: Journaled, moved_mm: float | None) -> str:
    """What does not agree; empty: all does.

    Args:
        said: by the client. lines: moves that it wanted. kept: by the journal.
        moved_mm: by the axis in the end; None: drives that are simulated began anew with the server.
    """
    accepted, done = int(str(said["accepted"])), int(str(said["done"]))
    if kept.gaps:
        return "the journal has lines twice, or not at all"
    if accepted > kept.accepted:
        return f"{accepted} lines were acknowledged, {kept.accepted} are in the journal"
    if done > kept.done:
        return f"{done} lines were acknowledged as done, the journal has {kept.done}"
    if kept.done > kept.accepted:
        return f"{kept.done} lines are done, {kept.accepted} were accepted"
    if said["state"] == "finished" and (done, kept.state, kept.done) != (accepted, "finished", kept.accepted):
        return f"finished with {done} of {accepted} done, the journal has {kept.state} with {kept.done}"
    if moved_mm is None:
        return ""
    steps = moved_mm / STEP_MM
    if kept.state == "finished":
        wanted = kept.accepted - len(HEAD)
        return (
            ""
            if abs(moved_mm - wanted * STEP_MM) <= TOLERANCE_MM
            else f"{wanted} lines moved it by {steps:.2f}"
        )
    least = max(0, kept.done - len(HEAD))
    most = min(lines, max(0, kept.accepted - len(HEAD)))
    if not least * STEP_MM - TOLERANCE_MM <= moved_mm <= most * STEP_MM + TOLERANCE_MM:
        return f"{least} lines are done and {most} were accepted, but the axis moved by {steps:.2f}"
    return ""
