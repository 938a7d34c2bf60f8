"""Refusals of the service that carry values, as docs/keyspace.md promises for their codes."""

from __future__ import annotations

from mcserver.errors import ProgramRejected, ServiceError
from mcserver.service.reports import WireDiagnostic


class Refused(ServiceError):
    """A request that the service refuses, with the values that its code promises."""

    def __init__(self, code: str, message: str, hint: str = "", **details: object) -> None:
        super().__init__(code, message, hint)
        self.details = details


class RejectedLines(ProgramRejected):
    """Lines of a submit were taken up to a faulty one; ``details`` has the numbers."""

    def __init__(self, diagnostics: list[WireDiagnostic], **details: object) -> None:
        super().__init__(diagnostics)
        self.details = details
