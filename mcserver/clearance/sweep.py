"""Whether bodies stay clear of each other over all that axes may pass, by conservative advancement.

What passes is a way of straight steps, while further columns may be anywhere in an interval of their own
(axes that move independently of the way, or belong to another program). Bodies that are d apart in the middle
of such a set stay apart by d less what half of it can change their distance (`Scene.levers`). Where that does
not show them clear the set is halved. So no contact is passed over; where a set is that of several axes that
need not come everywhere together, a contact may be found that would not come.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mcserver.clearance.mounted import Mounted
from mcserver.clearance.scene import Scene

Array = NDArray[np.float64]

# Sets are halved until they change a distance by less than this [m]; what comes nearer by less is no contact.
FINEST = 1e-5
# A distance of bodies that touch already may fall by this, which is the noise of distances [m].
NOISE = 2e-6
# Sets that are halved for one question, and more for each step; then what is not shown counts as a contact.
MOST_HALVED = 5_000
MORE_A_STEP = 50


class Contact(NamedTuple):
    """Where two bodies come too near: the pair, the step of the way that may bring them there, how far apart
    they are in it [m]; ``shown``: that was computed, else it could not be shown in time that they stay clear.
    """

    pair: int
    step: int
    distance: float
    shown: bool


class Sweep:
    """Answer for one machine whether its bodies stay clear.

    Args:
        margin: nearer than this is a contact [m].
        finest, share: sets that change a distance by less than this, or than this share of what is asked
            for, are halved no more [m]. most_halved: in one question, and more for each step.

    Attributes:
        scene: the bodies.
    """

    def __init__(
        self,
        scene: Scene,
        margin: float,
        finest: float = FINEST,
        share: float = 0.0,
        most_halved: int = MOST_HALVED,
    ) -> None:
        self.scene = scene
        self._margin = margin - FINEST
        self._finest = finest
        self._share = share
        self._most_halved = most_halved
        self._left = 0
        # of each pair the distance that was computed last, and where the axes were
        self._distance = np.full(len(scene.pairs), -np.inf)
        self._at = np.zeros(scene.levers.T.shape)

    def floors(self, positions: Array, before: Array | None = None) -> Array:
        """Return how near each pair may come, shape (P,) [m]: the margin; what is nearer already may
        only come apart.

        Args:
            positions: where the axes are, shape (K,) [SI].
            before: floors so far, which do not fall again.

        Returns:
            -inf for pairs whose tools are not mounted, and for slow zones.
        """
        active = self.scene.active & np.isinf(self.scene.speeds)
        low = np.where(active, self._margin, -np.inf)
        asked = np.flatnonzero(active if before is None else active & (before < self._margin)).tolist()
        if asked:
            self.scene.place(positions)
        for pair in asked:
            low[pair] = min(self._margin, self.scene.distance(pair) - NOISE)
        return low if before is None else np.where(active, np.maximum(low, before), low)

    def margins(self) -> Array:
        """Return how near each pair may come that is not nearer already, shape (P,) [m]; -inf as `floors`."""
        return np.where(self.scene.active & np.isinf(self.scene.speeds), self._margin, -np.inf)

    def mount(self, mounted: Mounted) -> None:
        """Take bodies of the tools that may be mounted from now on, and those that programs have brought."""
        given = self.scene.mounted.given
        self.scene.mount(mounted)
        if given != mounted.given:
            self._distance = self.scene.keep_own(self._distance, -np.inf)
            self._at = self.scene.keep_own(self._at.T, 0.0).T
        self._distance[self.scene.exchanged] = -np.inf

    def first_contact(
        self, way: Array, half: Array, moved: NDArray[np.bool_], floors: Array
    ) -> Contact | None:
        """Return the first contact on a way; None: all stay clear.

        Args:
            way: positions from where the axes are on, shape (n + 1, K) [SI]. half: by how much columns may be
                off it to both sides, shape (K,). moved: columns whose pairs are judged, shape (K,).
            floors: how near each pair may come, shape (P,) [m].
        """
        self._left = self._most_halved + MORE_A_STEP * len(way)
        levers = self.scene.levers
        total = np.zeros((len(way), levers.shape[1]))
        np.cumsum(np.abs(np.diff(way, axis=0)) @ levers, axis=0, out=total[1:])
        blur = half @ levers
        # no nearer at the start than by all that the axes have moved since
        least = self._distance - (np.abs(way[0] - self._at) * levers.T).sum(axis=1)
        near = levers[moved].any(axis=0) & (least - blur - total[-1] < floors)
        pairs = np.flatnonzero(near).tolist()
        self._look(pairs, way[0])
        found: Contact | None = None
        end = len(way) - 1
        for pair in pairs:
            at, distance = 0, float(self._distance[pair])
            while True:
                spare = distance - blur[pair] - floors[pair]
                # steps up to there are shown clear
                step = at + 1
                if spare >= 0.0:
                    step = max(step, int(np.searchsorted(total[:, pair], total[at, pair] + spare, "right")))
                if step > end:
                    break
                touch = self._near(pair, way[step - 1], way[step], half, float(floors[pair]))
                if touch is not None:
                    found = Contact(pair, step - 1, *touch)
                    # another one counts only before it
                    end = step - 1
                    break
                at = step
                self._look([pair], way[at])
                distance = float(self._distance[pair])
        return found

    def _look(self, pairs: Sequence[int], positions: Array) -> None:
        """Compute the distances of some pairs where the axes are."""
        if pairs:
            self.scene.place(positions)
        for pair in pairs:
            self._distance[pair], self._at[pair] = self.scene.distance(pair), positions

    def _near(
        self, pair: int, before: Array, after: Array, half: Array, floor: float
    ) -> tuple[float, bool] | None:
        """Return the distance of a contact on a step and whether it was computed; None: it is clear."""
        lever = self.scene.levers[:, pair]
        finest = max(self._finest, self._share * floor)
        sets = [(before, after, half)]
        while sets:
            one, other, off = sets.pop()
            middle = 0.5 * (one + other)
            self.scene.place(middle)
            distance = self.scene.distance(pair)
            along = 0.5 * float(np.abs(other - one) @ lever)
            across = off * lever
            spread = along + float(across.sum())
            if distance < floor:
                return distance, True
            if distance - spread >= floor or spread < finest:
                continue
            self._left -= 1
            if self._left < 0:
                return distance, False
            widest = int(np.argmax(across))
            if along >= across[widest]:
                sets += [(one, middle, off), (middle, other, off)]
                continue
            shift = np.zeros_like(off)
            shift[widest] = 0.5 * off[widest]
            off = off - shift
            sets += [(one - shift, other - shift, off), (one + shift, other + shift, off)]
        return None
