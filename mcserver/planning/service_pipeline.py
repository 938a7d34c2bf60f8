"""The pipeline of a program that a client feeds line by line."""

from __future__ import annotations

from mcserver.errors import ProgramRejected
from mcserver.motion.canonical import AxisLine
from mcserver.planning.pipeline import Pipeline, Report, ReportKind


class ServicePipeline(Pipeline):
    """A pipeline that outlives a faulty line, and tells how far it has read.

    Who types a line wrongly types it again: the faulty line changes neither modal state nor motion, so the
    program goes on with the same number, mended. Once no more lines can come, a fault ends the program.
    """

    @property
    def planned_line(self) -> int:
        """Every line through this one has been read without fault, and planned if it needs time."""
        if self._canonical:
            return self._canonical[0].line - 1
        return self._last_line - 1 if self._held is not None else self._last_line

    def _axis_line(self, line: AxisLine) -> None:
        # the executor says when it is done, as it does of motion
        self._reports.append(Report(ReportKind.PLANNED, line.line))
        super()._axis_line(line)

    def _interpret(self) -> bool:
        try:
            return super()._interpret()
        except ProgramRejected as rejected:
            if self._closed:
                raise
            faulty = rejected.diagnostics[0].line
            self._reports.append(Report(ReportKind.REJECTED, faulty, diagnostics=rejected.diagnostics))
            self._queue.clear()
            self._held = None
            self._last_line = faulty - 1
            return False
