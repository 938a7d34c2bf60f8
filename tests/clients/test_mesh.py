"""``mcctl mesh``: what a probing program meets, as a mesh that takes it away."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Sequence

import numpy as np
import pytest
from mcclient.cli.mesh import mesh_of, probed
from mcclient.errors import MotionError
from mcclient.types import Event, ProbeStatus

from mcserver.executor.error_tables import MeshErrors
from mcserver.machine.coupled_errors import Mesh

# height, X, Y: encoders come to rest a hair beside what was programmed
POINTS = [
    (-3.0, 0.001, 0.0),
    (-2.9, 59.999, 0.002),
    (-3.1, 0.0, 70.0),
    (-3.2, 60.0, 70.001),
]


def event(kind: str, program: str = "p1", point: Sequence[float] = (), **more: object) -> Event:
    probe = None
    if point:
        positions = {str(axis): value for axis, value in zip((2, 0, 1), point, strict=True)}
        probe = ProbeStatus(program=program, line=1, tripped=True, positions=positions, t=0.0)
    return Event(t=0.0, wall=0.0, instance="i", seq=1, kind=kind, program=program, probe=probe, **more)  # type: ignore[arg-type]


def collected(*events: Event) -> list[tuple[float, ...]]:
    async def told() -> AsyncIterator[Event]:
        for each in events:
            yield each

    return asyncio.run(probed(told(), (2, 0, 1)))


def test_a_drive_is_told_the_surface_that_was_met() -> None:
    found = mesh_of(POINTS)
    errors = MeshErrors(2, [0, 1], Mesh([0, 1], **found))
    for height, x, y in POINTS:
        # where the program goes to the height of the first point
        told = POINTS[0][0] - errors.at(np.array([round(x), round(y), 0.0]), np.zeros(3))[0]
        assert told == pytest.approx(height, abs=1e-4)


def test_points_of_the_first_program_that_probes_are_taken_up_to_its_end() -> None:
    ended = event("program.ended", state="finished")
    others = event("probe", "p2", (9.0, 9.0, 9.0)), event("program.ended", "p2", state="finished")
    found = collected(*(event("probe", point=point) for point in POINTS), *others, ended)
    assert found == POINTS
    with pytest.raises(MotionError, match="MC506"):
        collected(event("probe", point=POINTS[0]), event("program.ended", state="aborted"))
    with pytest.raises(MotionError, match="MC534"):
        collected(event("probe", point=POINTS[0]))


@pytest.mark.parametrize(
    ("points", "says"), [([], "2 by 2"), (POINTS[:2], "2 by 2"), (POINTS[:3], "60.0 70.0")]
)
def test_points_that_are_no_grid_are_refused_with_what_is_missing(
    points: list[tuple[float, ...]], says: str
) -> None:
    with pytest.raises(MotionError, match=says) as refused:
        mesh_of(points)
    assert refused.value.code == "MC093"


def test_a_grid_over_one_axis_twice_is_refused_before_anything_is_waited_for(
    mcctl: Callable[..., tuple[int, str, str]],
) -> None:
    code, _, err = mcctl("mesh", "Z", "X", "X")
    assert (code, "MC511" in err) == (2, True)
