"""Judge answers in a process of its own: whatever an answer makes the simulation do, it ends in time."""

from __future__ import annotations

import multiprocessing
import traceback
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from types import TracebackType

from mcbenchmark.tasks import Task
from mcbenchmark.verdict import Check, Finding, Verdict
from mcserver.errors import McError
from mcserver.simulation.worker_process import end_with_parent

# Longest time for one answer, compiling and loading of the machine included [s].
JUDGING_S = 120.0


class JudgeProcess:
    """A judge, started when it is first needed and again after it was ended.

    Args:
        judging_s: after which an answer has failed and the process is ended.
    """

    def __init__(self, judging_s: float = JUDGING_S) -> None:
        self._judging_s = judging_s
        self._process: BaseProcess | None = None
        self._pipe: Connection | None = None

    def __enter__(self) -> JudgeProcess:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def judge(self, task: Task, text: str) -> Verdict:
        """Judge an answer as `mcbenchmark.judge.judge` does.

        Raises:
            McError: the task's machine cannot be loaded.
        """
        pipe = self._started()
        try:
            pipe.send((task, text))
            if not pipe.poll(self._judging_s):
                self.close()
                return _failed(task, Check.ENDLESS, f"judging it took longer than {self._judging_s:g} s")
            answer = pipe.recv()
        except (EOFError, OSError):
            self.close()
            return _failed(task, Check.ENDLESS, "the process that judged it has died")
        if isinstance(answer, tuple):
            raise McError(*answer)
        if isinstance(answer, str):
            return _failed(task, Check.FAULT, f"the simulation failed: {answer}")
        assert isinstance(answer, Verdict)
        return answer

    def close(self) -> None:
        """End the process, whatever it is at."""
        process, self._process = self._process, None
        pipe, self._pipe = self._pipe, None
        if pipe is not None:
            pipe.close()
        if process is not None:
            process.kill()
            process.join()
            process.close()

    def _started(self) -> Connection:
        if self._pipe is None:
            context = multiprocessing.get_context("spawn")
            self._pipe, theirs = context.Pipe()
            self._process = context.Process(target=_serve, args=(theirs,), daemon=True)
            self._process.start()
            theirs.close()
        return self._pipe


def _serve(pipe: Connection) -> None:
    """Answer with verdicts, with the fields of an error of the machine, or with a traceback's last line."""
    # the command that starts this process needs none of what simulates
    from mcbenchmark.judge import judge

    end_with_parent()
    while True:
        try:
            task, text = pipe.recv()
        except EOFError:
            return
        try:
            pipe.send(judge(task, text))
        except McError as error:
            pipe.send((error.code, error.message, error.hint))
        except Exception as error:
            pipe.send("".join(traceback.format_exception_only(error)).strip()[:500])


def _failed(task: Task, check: Check, message: str) -> Verdict:
    return Verdict(task.id, task.category, (Finding(check, message),))
