"""Programs on machines whose axes follow others, played under orders."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from mcserver.drives.simulated import SimulatedBus
from mcserver.executor.entries import Array
from mcserver.executor.leading_curves import curve_of
from tests.executor.planned import Planned
from tests.limits import broken_limits, limits_of

LAW = settings(
    max_examples=6,
    phases=(Phase.explicit, Phase.generate),
    derandomize=True,
    database=None,
    suppress_health_check=list(HealthCheck),
)


class Coupled(Planned):
    """A program, played to its end with orders on the way.

    Attributes:
        led: axes that are moved from outside.
    """

    led: tuple[int, ...] = (5,)

    def play(
        self, orders: Mapping[int, Callable[[Coupled], None]] | None = None, cycles: int = 20_000
    ) -> Coupled:
        for cycle in range(cycles):
            if orders and cycle in orders:
                orders[cycle](self)
            self.step()
            if self.ended and self.executor.at_rest:
                return self
        raise AssertionError("no end")

    @property
    def bus(self) -> SimulatedBus:
        found = [each for each in self.executor.executor.bank.buses if isinstance(each, SimulatedBus)]
        return found[0]

    def column(self, axis: int) -> int:
        """The column of an axis."""
        return self.machine.column_of(axis)

    def setpoints(self, axis: int) -> Array:
        return np.array(self.rows)[:, self.machine.column_of(axis)]

    def broken(self, *, jerk: bool = True, but: tuple[int, ...] | None = None) -> list[str]:
        """Limits of the file that setpoints pass in any cycle; ``but``: not of these axes, None: `led`."""
        limits = np.array(limits_of(self.machine, whole=True))
        left_out = self.led if but is None else but
        kept = [n for n, axis in enumerate(self.machine.axes) if axis.index not in left_out]
        return broken_limits(np.array(self.rows)[:, kept], limits[: 3 if jerk else 2, kept])

    def beside(self, axis: int, until: int | None = None) -> Array:
        """How far a follower is from where its leader's setpoint has it [m or rad]."""
        follow = self.machine.axes[self.machine.column_of(axis)].follow
        assert follow is not None
        curve = curve_of(follow)
        led = np.array([curve.at(place)[0] for place in self.setpoints(follow.leader).tolist()])
        return np.abs(self.setpoints(axis) - led)[:until]


def abort(each: Coupled) -> None:
    each.executor.mailbox.abort(0)


def stop(each: Coupled) -> None:
    each.executor.mailbox.emergency_stop()


def hold(each: Coupled) -> None:
    each.executor.mailbox.set_hold(True, 0)


def resume(each: Coupled) -> None:
    each.executor.mailbox.set_hold(False, 0)


def override(share: float) -> Callable[[Coupled], None]:
    return lambda each: each.executor.mailbox.set_override(share, 0)


def under_orders(last: int, *, ends_from: int) -> Callable[..., Any]:
    """Give a law up to eight orders by their cycles, and an abort or an emergency stop at one of them."""
    orders = st.sampled_from([hold, resume, override(0.2), override(1.0), override(1.5)])
    given_orders = given(
        st.dictionaries(st.integers(30, last), orders, max_size=8),
        st.integers(ends_from, last),
        st.sampled_from([abort, stop]),
    )
    return lambda law: LAW(given_orders(law))


def eye(*risen: float) -> str:
    """An input that works pass at these times [s]."""
    values = ((at + later, value) for at in risen for later, value in ((0.0, "true"), (0.05, "false")))
    script = ", ".join(f"{{ at_s = {at:.3f}, value = {value} }}" for at, value in values)
    return f'[[input]]\nnumber = 4\nname = "eye"\nsimulated = [{script}]\n'


def pushed(cycles: range) -> st.SearchStrategy[dict[int, tuple[str, float]]]:
    """By cycles, how the drive of an axis is pushed about or loaded."""
    push = st.tuples(st.sampled_from(["push", "load"]), st.floats(-5.0, 5.0))
    return st.dictionaries(st.sampled_from(cycles), push, max_size=6)


def pushes(what: Mapping[int, tuple[str, float]], axis: int) -> dict[int, Callable[[Coupled], None]]:
    return {
        cycle: lambda each, kind=kind, value=value: getattr(each.bus, kind)(each.column(axis), value)
        for cycle, (kind, value) in what.items()
    }
