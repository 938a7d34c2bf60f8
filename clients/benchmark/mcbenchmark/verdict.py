"""What a judge finds in an answer."""

from __future__ import annotations

import enum

import msgspec


class Check(enum.StrEnum):
    """What of an answer a finding is about."""

    ANSWER = "answer"  # it is missing, or too long
    REJECTED = "rejected"  # `mcserver check` refuses it
    FAULT = "fault"  # it fails while running
    ENDLESS = "endless"  # it takes longer than the task allows
    PATH = "path"
    STRAY = "stray"  # something moves that nobody asked for
    END = "end"
    DURATION = "duration"
    ZONE = "zone"
    CODES = "codes"
    AXES = "axes"


class Finding(msgspec.Struct, frozen=True):
    """One reason why an answer fails."""

    check: Check
    message: str


class Verdict(msgspec.Struct, frozen=True):
    """What the judge says of an answer: it passes if there is no finding."""

    task: str
    category: str
    findings: tuple[Finding, ...] = ()

    @property
    def passed(self) -> bool:
        return not self.findings
