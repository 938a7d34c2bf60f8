"""Parameters of a program: numbered, local and global ones, and the arguments of its subprograms."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import msgspec

from mcserver.gcode.computing.expressions import ComputingError
from mcserver.gcode.line_faults import Span

if TYPE_CHECKING:
    from mcserver.gcode.computing.saved_state import SavedState

# numbered parameters from 1 on that are local to a call, as most named ones are
LOCAL = 30
# named parameters that one program may set
MOST_NAMES = 10_000
# numbers that LinuxCNC's machine provides or measures: programs only read them
_OF_THE_MACHINE = frozenset({*range(5021, 5030), *range(5061, 5603)})


class Scope:
    """The parameters of one call: local numbered ones, and names without an underscore."""

    __slots__ = ("named", "numbered", "returns", "saved")

    def __init__(self, arguments: tuple[float, ...] = (), local: int = LOCAL, unset: float = 0.0) -> None:
        self.numbered = [unset, *arguments, *[unset] * (local - len(arguments))]
        self.named: dict[str, float] = {}
        # saved by M70 and M73 (D-138); restored when the call returns if ``returns``
        self.saved: SavedState | None = None
        self.returns = False


class ComputedState(msgspec.Struct, frozen=True):
    """Parameters and subprograms of a program between two lines, from where it can continue.

    Attributes:
        numbered: parameters that were set; None: to no value, or 0. local: names of the main program. named:
            global names. subprograms: text of their lines, by line number.
    """

    numbered: Mapping[int, float | None] = {}
    local: Mapping[str, float] = {}
    named: Mapping[str, float] = {}
    subprograms: Mapping[int, str] = {}


def stays(number: int, persistent: tuple[tuple[int, int], ...]) -> bool:
    """Return whether a parameter is among those of which first and last are given."""
    return any(first <= number <= last for first, last in persistent)


class ParameterTable:
    """Parameters that a program sets itself (D-81).

    Args:
        local: count of numbered ones that are local to a call. unset: value of one that was never set.
        persistent: first and last of those that stay for later programs.

    Attributes:
        scopes: of the main program and of the running calls.
    """

    def __init__(
        self,
        kept: ComputedState,
        local: int = LOCAL,
        unset: float = 0.0,
        persistent: tuple[tuple[int, int], ...] = (),
    ) -> None:
        self._local = local
        self._unset = unset
        self._persistent = persistent
        self._lasting: Mapping[int, float] | None = None
        self.scopes = [self.scope()]
        self._numbered: dict[int, float] = {}
        self._named = dict(kept.named)
        self.scopes[0].named.update(kept.local)
        for number, value in kept.numbered.items():
            where = self.scopes[0].numbered if number <= local else self._numbered
            where[number] = unset if value is None else value

    def scope(self, arguments: tuple[float, ...] = ()) -> Scope:
        """Create the parameters of a call."""
        return Scope(arguments, self._local, self._unset)

    def has(self, number: int) -> bool:
        """Return whether a parameter that is not local was set."""
        return number in self._numbered

    def kept(self) -> ComputedState:
        """Return the parameters of the main program, and the global ones."""
        main = self.scopes[0]
        local = {each: value for each, value in enumerate(main.numbered) if self._is_set(value)}
        shared = {each: value if self._is_set(value) else None for each, value in self._numbered.items()}
        return ComputedState({**shared, **local}, dict(main.named), dict(self._named))

    def lasting(self) -> Mapping[int, float]:
        """Return the parameters that stay for later programs; the same object until one is set."""
        if self._lasting is None:
            self._lasting = {
                number: value
                for number, value in self._numbered.items()
                if stays(number, self._persistent) and self._is_set(value)
            }
        return self._lasting

    def _is_set(self, value: float) -> bool:
        return (type(value), value) != (type(self._unset), self._unset)

    def numbered(self, number: int) -> float:
        """Return a numbered parameter; one that was never set is `unset`."""
        if number <= self._local:
            return self.scopes[-1].numbered[number]
        return self._numbered.get(number, self._unset)

    def named(self, name: str) -> float | None:
        """Return a named parameter; None if it was never set."""
        return (self._named if name.startswith("_") else self.scopes[-1].named).get(name)

    def set_numbered(self, number: int, value: float) -> None:
        """Set a numbered parameter; number 0 stands for one that could not be computed."""
        if number <= self._local:
            self.scopes[-1].numbered[number] = value
        else:
            self._numbered[number] = value
            if stays(number, self._persistent):
                self._lasting = None

    def set_named(self, name: str, value: float, span: Span = (1, 2)) -> None:
        """Set a named parameter; a name that begins with ``_`` is global.

        Raises:
            ComputingError: MC164 there are too many.
        """
        names = self._named if name.startswith("_") else self.scopes[-1].named
        if name not in names and len(names) >= MOST_NAMES:
            raise ComputingError("MC164", f"the program has more than {MOST_NAMES} names", span)
        names[name] = value


def check_own(number: int, span: Span) -> None:
    """Refuse to set a parameter of the machine.

    Raises:
        ComputingError: MC162.
    """
    if number in _OF_THE_MACHINE:
        hint = "G10 L2, G92 and G28.1 set offsets and stored positions" if number < 5400 else ""
        raise ComputingError(
            "MC162", f"#{number} is read, not set: the machine has it", span, hint or "use another parameter"
        )
