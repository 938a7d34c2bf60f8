"""Tool waypoints a second: sparse knots with a checked spline, beside solvers that take each point alone."""

from __future__ import annotations

import importlib.util

from tests.bench.figures import Figure, NotAvailable, processor_seconds

GOAL = "≥ 500 k/s"
RUNS = 9
PEER_RUNS = 3
# robot, tool, where its path ends [m], and the angles A B C there [rad]
STROKES = {
    "a leg of the dog, 800 mm": ("robot-dog", 3, (-0.159, -0.4, 0.8), None),
    "the arm, 410 mm and a turn of 49°": ("arm6", 1, (0.5, -0.3, 0.4), (0.3, -0.4, 0.7)),
}


def measure() -> list[Figure]:
    """Each stroke solved and evaluated at its 1000 waypoints; the peers solve each waypoint from the last."""
    if importlib.util.find_spec("pinocchio") is None:
        raise NotAvailable("no Pinocchio: pip install pin scipy")
    from tests.bench.strokes import WAYPOINTS, DensePinocchio, kdl, largest_error, solve, stroke

    figures = []
    for name, asked in STROKES.items():
        this = stroke(*asked)
        dense = DensePinocchio(this)
        ours = WAYPOINTS / processor_seconds(lambda this=this: solve(this), runs=RUNS)
        what = f"{name}: waypoints"
        peer = WAYPOINTS / processor_seconds(dense.solve, runs=PEER_RUNS)
        against = f"a dense Pinocchio loop, {_micrometres(largest_error(this, dense.solve()))}"
        figures.append(Figure(what, ours, "/s", peer, against, GOAL))
        try:
            taken, joints = kdl(this, PEER_RUNS)
        except NotAvailable as reason:
            figures.append(Figure(what, ours, "/s", None, f"PyKDL: {reason}", GOAL))
        else:
            against = f"PyKDL's LMA loop, {_micrometres(largest_error(this, joints))}"
            figures.append(Figure(what, ours, "/s", WAYPOINTS / taken, against, GOAL))
        true = 1e6 * largest_error(this, solve(this))
        figures.append(Figure(f"{name}: off its path", true, "µm", 10.0, "the tolerance", "≤ 10 µm"))
    return figures


def _micrometres(metres: float) -> str:
    return f"{1e6 * metres:.2g} µm off"
