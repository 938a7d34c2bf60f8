"""Zones that an input switches on, as they bind one program."""

from __future__ import annotations

import numpy as np

from mcserver.clearance.ordered_speeds import slow_zones
from mcserver.clearance.scene import Scene
from mcserver.machine.machine_file import Machine
from mcserver.planning.shared_space import Array, Mask


class SwitchedZones:
    """The zones that one input switches on, as they bind one program.

    Attributes:
        bit: of them, in what the executor is told. counted: their pairs, shape (P,). slow: slow ones of them.
        number, high: of the input, and its level where they are on.
        movers: columns that move their bodies, shape (K,).
    """

    def __init__(self, machine: Machine, scene: Scene, number: int, binding: Mask) -> None:
        assert machine.clearance is not None
        self.bit = 1 << number
        self._number = number
        self.counted: Mask = binding & (scene.switches == number)
        self.slow = slow_zones(scene, machine, self.counted)
        self.movers: Mask = np.zeros(len(machine.axes), np.bool_)
        self.count(scene, binding)
        switch = machine.clearance.switches[number]
        self._high = switch.high
        self._column = [(each.digital, each.number) for each in machine.inputs].index((True, switch.input))

    def count(self, scene: Scene, binding: Mask) -> None:
        """Take the pairs that a scene has now."""
        self.counted = binding & (scene.switches == self._number)
        self.slow.count(self.counted)
        self.movers = np.asarray(scene.levers[:, self.counted].any(axis=1))

    def on(self, inputs: Array) -> bool:
        """Return whether they are on by the inputs' values."""
        return bool(inputs[self._column]) is self._high
