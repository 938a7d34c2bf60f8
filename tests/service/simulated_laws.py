"""What has to hold in a simulated cell."""

from __future__ import annotations

from collections.abc import Callable

from mcserver.service.reports import ENDED


class Violation(AssertionError):
    """Something that has to hold did not."""


def require(holds: bool, what: str) -> None:
    if not holds:
        raise Violation(what)


class Said:
    """What was said of programs: never more than has ended, and never more than the journal has.

    Args:
        ended: number of the last line that has ended, of a program.
        journaled: how far the journal has it, and its state there.
    """

    def __init__(
        self, ended: Callable[[str], int], journaled: Callable[[str], tuple[int, str | None]]
    ) -> None:
        self._ended = ended
        self._journaled = journaled
        self._done: dict[str, int] = {}
        self._states: dict[str, str] = {}

    def hear(self, what: str, program: str, done: int, state: str | None) -> None:
        """Judge what is said now; ``state`` is None where none is said."""
        ended = self._ended(program)
        require(done <= ended, f"{what} says that {program} is done through {done}; {ended} has ended")
        if done > self._done.get(program, 0) or (state in ENDED and program not in self._states):
            kept, kept_state = self._journaled(program)
            require(
                done <= kept, f"{what} says that {program} is done through {done}; the journal has {kept}"
            )
            self._done[program] = max(done, self._done.get(program, 0))
            if state in ENDED and state is not None:
                require(
                    kept_state == state, f"{what} says {program} is {state}; the journal has {kept_state}"
                )
                self._states[program] = state

    def judge_after_a_kill(self) -> None:
        """Judge whether the journal still has what was said."""
        for program, done in self._done.items():
            kept, _ = self._journaled(program)
            require(done <= kept, f"{program} was said to be done through {done}; the journal has {kept}")
        for program, state in self._states.items():
            _, kept_state = self._journaled(program)
            require(state == kept_state, f"{program} was said to be {state}; the journal has {kept_state}")
