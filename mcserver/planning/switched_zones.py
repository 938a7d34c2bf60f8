"""The zones that an input switches on, for one program."""

from __future__ import annotations

import numpy as np

from mcserver.clearance.ordered_speeds import slow_zones
from mcserver.clearance.scene import Scene
from mcserver.machine.machine_file import Machine
from mcserver.planning.shared_space import Array, Mask


class SwitchedZones:
    """The zones that one input switches on, of those that bind one program.

    Attributes:
        bit: of these zones in the mask for the executor. counted: their pairs of the scene, shape (P,).
        slow: the slow zones among them. number, high: of the input, and its level with the zones on.
        movers: columns that move their bodies, shape (K,).
    """

    def __init__(self, machine: Machine, scene: Scene, number: int, binding: Mask) -> None:
        assert machine.clearance is not None
        self.bit = 1 << number
        self._number = number
        self.slow = slow_zones(scene, machine, binding & (scene.switches == number))
        self.count(scene, binding)
        switch = machine.clearance.switches[number]
        self._high = switch.high
        self._column = [(each.digital, each.number) for each in machine.inputs].index((True, switch.input))

    def count(self, scene: Scene, binding: Mask) -> None:
        """Count the present pairs of a scene."""
        self.counted: Mask = binding & (scene.switches == self._number)
        self.slow.count(self.counted)
        self.movers: Mask = np.asarray(scene.levers[:, self.counted].any(axis=1))

    def on(self, inputs: Array) -> bool:
        """Return whether the zones are on, given the inputs' values."""
        return bool(inputs[self._column]) is self._high
