"""What a program comes near to, found on every cycle of its simulation."""

from __future__ import annotations

import random
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mckinematics.model import read_urdf
from scipy.spatial import ConvexHull

from mcserver.clearance import meshes
from mcserver.clearance.meter import FAR, MOST_SHOWN, RESOLUTION, SHARE, ClearanceMeter
from mcserver.clearance.scene import Scene
from mcserver.errors import ConfigurationError
from mcserver.machine.machine_file import Machine, builtin_text, parse_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.simulation.simulation import simulate
from mcserver.units import MM
from tests.clearance.machines import VISE, arm, block, mill


def run(text: str, machine: Machine, **more: Any) -> Any:
    return simulate(text, machine, kinematics=build_kinematics(machine), **more)


def least(found: Any, one: str, other: str) -> float:
    (row,) = [each for each in found.report["clearance"]["pairs"] if each["bodies"] == [one, other]]
    return float(row["least_mm"])


def test_a_tool_that_passes_over_a_vise_is_told_how_near_it_came() -> None:
    found = run("G1010\nG1 Z43 F6000\nG1 X150\nG1 X300\n", mill(VISE))
    assert found.report["ok"]
    assert found.exit_code == 0
    assert least(found, "tool", "vise") == pytest.approx(3.0, rel=SHARE)


def test_the_first_contact_is_an_error_at_its_line_and_the_way_back_none_more() -> None:
    found = run("G1010\nG1 Z43 F6000\nG1 X150\nG1 Z40.5\nG1 Z43\nG1 Z40\n", mill(VISE))
    (fault,) = found.report["diagnostics"]
    assert (fault["code"], fault["line"], fault["severity"]) == ("MC320", 4, "error")
    assert "'tool'" in fault["message"]
    assert "'vise'" in fault["message"]
    assert not found.report["ok"]
    assert found.exit_code == 1


def test_a_rapid_is_looked_at_as_it_runs() -> None:
    found = run("G1010\nG0 Z20\nG0 X150\n", mill(VISE))
    assert [(each["code"], each["line"]) for each in found.report["diagnostics"]] == [("MC320", 3)]


def test_what_touches_before_the_first_line_is_said_so() -> None:
    found = run("G1010\n", mill(block("lump", (0.0, 0.0, 120.0), 10.0)))
    (fault,) = found.report["diagnostics"]
    assert fault["line"] == 0
    assert "before the program begins" in fault["message"]


def test_a_thin_wall_between_two_cycles_is_found() -> None:
    # 200 mm/s: 0.2 mm a cycle; the probe is 0.04 mm thick, the wall 0.02 mm
    needle = """
[clearance]
margin_mm = 0.0
[[body]]
name = "needle"
shape = "box"
size_mm = [0.02, 1.0, 1.0]
carried_by = [0]
[[body]]
name = "wall"
shape = "box"
size_mm = [0.02, 1.0, 1.0]
at_mm = [50.07, 0.0, 0.0]
"""
    machine = mill(needle + '[[zone]]\nname = "none"\nsize_mm = [1.0, 1.0, 1.0]\nat_mm = [0.0, 900.0, 0.0]\n')
    found = run("G1010\nG1 X100 F12000\n", machine, record=True)
    # nowhere near it in any cycle: it is between two of them
    scene = Scene(machine)
    pair = [each.names for each in scene.pairs].index(("needle", "wall"))
    distances = []
    for row in found.recording.setpoint * MM:
        scene.place(row)
        distances.append(scene.distance(pair))
    assert min(distances) > 0.0
    assert [each["code"] for each in found.report["diagnostics"]] == ["MC320"]


def test_a_table_moves_against_its_axis() -> None:
    post = """
[[body]]
name = "post"
shape = "cylinder"
radius_mm = 10.0
length_mm = 20.0
at_mm = [100.0, 0.0, 100.0]
carried_by = [0]
opposite = true
[[body]]
name = "column"
shape = "box"
size_mm = [10.0, 10.0, 300.0]
at_mm = [-100.0, 0.0, 0.0]
"""
    away = run("G1010\nG1 Y60 F6000\nG1 X-190\n", mill(post))
    assert away.report["ok"]
    hit = run("G1010\nG1 Y60 F6000\nG1 X190\n", mill(post))
    # 200 mm of way less 10 and 5 mm
    assert [each["line"] for each in hit.report["diagnostics"]] == [3]


@pytest.mark.parametrize(("target", "codes"), [(90.0, []), (98.0, ["MC321"])])
def test_a_zone_keeps_bodies_in(target: float, codes: list[str]) -> None:
    zone = '[[zone]]\nname = "cell"\nkind = "keep_in"\nsize_mm = [200.0, 300.0, 400.0]\n'
    found = run(f"G1010\nG1 X{target} F6000\n", mill(zone))
    assert [each["code"] for each in found.report["diagnostics"]] == codes
    assert all(
        " leaves the keep-in zone 'cell' at " in each["message"] for each in found.report["diagnostics"]
    )


def test_a_zone_keeps_bodies_out() -> None:
    zone = '[[zone]]\nname = "door"\nsize_mm = [20.0, 400.0, 400.0]\nat_mm = [60.0, 0.0, 100.0]\n'
    found = run("G1010\nG1 X50 F6000\n", mill(zone))
    assert found.report["diagnostics"]
    for each in found.report["diagnostics"]:
        assert (each["code"], each["line"]) == ("MC321", 2)
        assert " enters the keep-out zone 'door' at " in each["message"]


def test_a_zone_keeps_only_the_bodies_out_that_it_names() -> None:
    zone = (
        '[[zone]]\nname = "{}"\nsize_mm = [20.0, 20.0, 20.0]\nat_mm = [100.0, 0.0, 100.0]\nbodies = ["{}"]\n'
    )
    other = """
[[body]]
name = "nozzle"
shape = "sphere"
radius_mm = 2.0
at_mm = [0.0, 50.0, 0.0]
carried_by = [0, 1, 2]
"""
    lines = "G1010\nG1 X100 F6000\n"
    assert run(lines, mill(other, zone.format("door", "nozzle"))).report["ok"]
    found = run(lines, mill(other, zone.format("door", "tool")))
    assert "'door'" in found.report["diagnostics"][0]["message"]


def test_an_arm_that_folds_into_itself_is_found_without_a_word_of_its_bodies() -> None:
    stretched = run("G1010\nG1 Z-120 F6000\n", arm("[clearance]\n"))
    assert stretched.report["clearance"]["least_mm"] > 1.0
    folded = run("G1010\nG1 Z150 F6000\n", arm("[clearance]\n"))
    assert {each["code"] for each in folded.report["diagnostics"]} == {"MC320"}
    assert least(folded, "upper_arm", "forearm") < 1.0


def distances_of(machine: Machine, rows: Any) -> Any:
    """Distance of every pair in every cycle, shape (n, P)."""
    scene = Scene(machine)
    found = []
    for row in rows:
        scene.place(row)
        found.append([scene.distance(pair) for pair in range(len(scene.pairs))])
    return np.array(found)


def random_rows(machine: Machine, seed: int) -> Any:
    """A smooth random way of all axes within their travel, one row a cycle."""
    draw = np.random.default_rng(seed)
    low = np.array([max(axis.min_position, -0.3) for axis in machine.axes])
    high = np.array([min(axis.max_position, 0.3) for axis in machine.axes])
    start = np.array([axis.initial_position for axis in machine.axes])
    knots = np.vstack([start, draw.uniform(low, high, (3, len(low)))])
    t = np.linspace(0.0, 1.0, 250)[:, None]
    ease = t * t * (3.0 - 2.0 * t)
    return np.concatenate([a + ease * (b - a) for a, b in pairwise(knots)])


@pytest.mark.parametrize("seed", range(12))
def test_the_least_distances_are_those_of_every_cycle(seed: int) -> None:
    draw = random.Random(seed)
    machine = (arm, mill)[seed % 2](
        block("block", tuple(draw.uniform(-400.0, 400.0) for _ in range(3)), draw.uniform(20.0, 150.0)),
        '[clearance]\nmargin_mm = 0.5\nallowed = [["block", "base"]]\n' if seed % 2 == 0 else "",
    )
    rows = random_rows(machine, seed)
    meter = ClearanceMeter(machine, rows[0])
    times = np.arange(len(rows)) * machine.cycle_s
    lines = np.arange(len(rows)) // 100 + 1
    at = 0
    while at < len(rows):
        count = draw.choice((1, 1, 7, 300))
        meter.take(times[at : at + count], lines[at : at + count], rows[at : at + count])
        at += count
    exact = distances_of(machine, rows)
    margin = 0.5e-3 if seed % 2 == 0 else 1e-3
    names = [pair.names for pair in Scene(machine).pairs]
    report = {tuple(each["bodies"]): each for each in meter.report()["pairs"]}
    touched = {tuple(name) for name, column in zip(names, exact.T, strict=True) if column.min() < margin}
    said = {name for name, each in report.items() if each["least_mm"] < margin / MM}
    # what lies between two cycles may touch too
    assert touched <= said
    near = {name for name, column in zip(names, exact.T, strict=True) if column.min() < margin + FAR}
    assert near == report.keys() or len(report) == MOST_SHOWN
    for name, each in report.items():
        if name not in said:
            true = min(column.min() for other, column in zip(names, exact.T, strict=True) if other == name)
            assert each["least_mm"] * MM <= true + max(RESOLUTION, SHARE * true) + 1e-6
            assert each["least_mm"] * MM >= true - 1e-5


@pytest.mark.parametrize("seed", range(6))
def test_an_obstacle_planted_in_the_way_is_found_and_one_moved_clear_is_not(seed: int) -> None:
    machine = arm("[clearance]\nmargin_mm = 0.0\n")
    rows = random_rows(machine, 100 + seed)
    kinematics = build_kinematics(machine)
    assert kinematics is not None
    chain = kinematics.tool(1).chain
    tip = chain.forward(rows[len(rows) // 2 : len(rows) // 2 + 1])[0][0] / MM
    planted = arm("[clearance]\nmargin_mm = 0.0\n", block("post", tuple(tip.tolist()), 30.0))
    lines = np.ones(len(rows), np.int64)
    times = np.arange(len(rows)) * 1e-3
    meter = ClearanceMeter(planted, rows[0])
    meter.take(times, lines, rows)
    assert any("'post'" in each.message for each in meter.contacts())
    # as large as leaves 1 mm everywhere
    exact = distances_of(arm("[clearance]\nmargin_mm = 0.0\n", block("post", (*tip[:2], 3000.0), 30.0)), rows)
    names = [pair.names for pair in Scene(planted).pairs]
    over = min(column.min() for name, column in zip(names, exact.T, strict=True) if "post" in name)
    clear = arm("[clearance]\nmargin_mm = 0.0\n", block("post", (*tip[:2], 3000.0 - over / MM + 1.0), 30.0))
    meter = ClearanceMeter(clear, rows[0])
    meter.take(times, lines, rows)
    assert not any("'post'" in each.message for each in meter.contacts())


def test_a_mesh_counts_as_its_convex_hull(tmp_path: Path) -> None:
    # a wedge
    faces = ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2))
    corners = ((0, 0, 0), (40, 0, 0), (0, 40, 0), (0, 0, 40))
    text = "solid wedge\n"
    for face in faces:
        text += "facet normal 0 0 0\nouter loop\n"
        text += "".join("vertex {} {} {}\n".format(*corners[each]) for each in face)
        text += "endloop\nendfacet\n"
    path = tmp_path / "wedge.stl"
    path.write_text(text + "endsolid wedge\n")
    body = f'[[body]]\nname = "wedge"\nshape = "mesh"\nfile = "{path}"\nat_mm = [100.0, 0.0, 0.0]\n'
    found = run("G1010\nG1 X120 F6000\nG1 Z45\n", mill(body))
    assert found.report["ok"]
    assert least(found, "tool", "wedge") == pytest.approx(10.0, rel=0.8)
    assert not run("G1010\nG1 X110 F6000\nG1 Z20\n", mill(body)).report["ok"]


def mesh_of(path: Path, triangles: Any) -> str:
    """A body of a binary STL of triangles, shape (n, 3, 3) [mm]."""
    found = np.zeros(len(triangles), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    found["corners"] = triangles
    path.write_bytes(bytes(80) + len(triangles).to_bytes(4, "little") + found.tobytes())
    return f'[[body]]\nname = "lump"\nshape = "mesh"\nfile = "{path}"\n'


FLAT = [[(0, 0, 0), (10, 0, 0), (0, 10, 0)], [(10, 0, 0), (10, 10, 0), (0, 10, 0)]]
SOLID = [
    [(0, 0, 0), (0, 9, 0), (9, 0, 0)],
    [(0, 0, 0), (9, 0, 0), (0, 0, 9)],
    [(9, 0, 0), (0, 9, 0), (0, 0, 9)],
    [(0, 0, 0), (0, 0, 9), (0, 9, 0)],
]


@pytest.mark.parametrize(
    ("triangles", "message"),
    [
        (FLAT, "flat"),
        (FLAT[:1], "flat"),
        ([[(0, 0, 0)] * 3] * 4, "read"),
        (np.array(SOLID) * np.nan, "no numbers"),
        (np.where(np.arange(36).reshape(4, 3, 3) == 17, np.nan, SOLID), "no numbers"),
        (np.where(np.arange(36).reshape(4, 3, 3) == 17, np.inf, SOLID), "no numbers"),
    ],
)
def test_a_mesh_without_a_hull_is_refused(triangles: Any, message: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=message) as raised:
        Scene(mill(mesh_of(tmp_path / "lump.stl", triangles)))
    assert raised.value.code == "MC323"
    assert "lump" in raised.value.message
    assert "\n" not in raised.value.message


@pytest.mark.parametrize("stretch", [(1.0, 1.0, 1.0), (1.0, 0.02, 0.02), (1.0, 1.0, 1e-4)])
@pytest.mark.parametrize("seed", range(4))
def test_what_encloses_a_mesh_has_every_corner_inside_and_is_little_larger(
    seed: int, stretch: tuple[float, ...]
) -> None:
    draw = np.random.default_rng(seed)
    kinds = (
        draw.normal(size=(3000, 3)),
        draw.uniform(-1.0, 1.0, (3000, 3)),
        np.vstack([0.1 * draw.normal(size=(3000, 3)), np.eye(3)]),
        draw.normal(size=(8, 3)),
    )
    turned = np.linalg.qr(draw.normal(size=(3, 3)))[0]
    corners = 0.2 * kinds[seed] * np.array(stretch) @ turned + draw.normal(size=3)
    main = np.linalg.svd(corners - corners.mean(axis=0), full_matrices=False)[2]
    around = ConvexHull(meshes.enclosing_corners(corners, main))
    beyond = around.equations[:, :3] @ corners.T + around.equations[:, 3:]
    assert beyond.max() <= 1e-12
    own = ConvexHull(corners)
    further = own.equations[:, :3] @ around.points.T + own.equations[:, 3:]
    assert further.max() <= 0.15 * np.linalg.norm(np.ptp(corners, axis=0))


def test_a_ball_of_too_many_corners_is_enclosed_to_a_hundredth() -> None:
    ball = np.random.default_rng(0).normal(size=(20_000, 3))
    ball /= np.linalg.norm(ball, axis=1)[:, None]
    around = np.linalg.norm(meshes.enclosing_corners(ball, np.eye(3)), axis=1)
    assert around.min() >= 1.0
    assert around.max() <= 1.01


def test_a_mesh_that_is_too_fine_is_enclosed_and_its_file_refused_before_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    body = mesh_of(tmp_path / "lump.stl", SOLID) + "at_mm = [100.0, 0.0, 0.0]\n"
    near = "G1010\nG1 X114 F6000\nG1 Z{}\n"
    for corners in (meshes.MOST_CORNERS, 3):
        monkeypatch.setattr(meshes, "MOST_CORNERS", corners)
        assert run(near.format(10.1), mill(body)).report["ok"]
        assert not run(near.format(0.0).replace("114", "104"), mill(body)).report["ok"]
    monkeypatch.setattr(meshes, "MOST_BYTES", 100)
    with pytest.raises(ConfigurationError, match="MiB"):
        Scene(mill(body))


def test_a_mesh_of_the_urdf_that_is_too_large_is_refused_before_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh_of(tmp_path / "base.stl", SOLID)
    urdf = read_urdf("arm6.urdf")
    for name in ("package://cell/base.stl", f"file://{tmp_path}/cell/base.stl"):
        (tmp_path / "cell").mkdir(exist_ok=True)
        (tmp_path / "base.stl").rename(tmp_path / "cell" / "base.stl")
        (tmp_path / "arm.urdf").write_text(
            urdf.replace('<cylinder radius="0.110" length="0.180"/>', f'<mesh filename="{name}"/>')
        )
        text = builtin_text("arm6").replace("arm6.urdf", str(tmp_path / "arm.urdf")) + "[clearance]\n"
        with monkeypatch.context() as patch:
            Scene(parse_machine(text))
            patch.setattr(meshes, "MOST_BYTES", 100)
            with pytest.raises(ConfigurationError, match="of the URDF has more than"):
                Scene(parse_machine(text))
        (tmp_path / "cell" / "base.stl").rename(tmp_path / "base.stl")


@pytest.mark.parametrize(("value", "code"), [("nan", "MC004"), ("inf", "MC004"), ("1e300", "MC003")])
@pytest.mark.parametrize("key", ["at_mm", "turned_deg", "size_mm"])
def test_places_and_sizes_are_numbers_of_a_machine(key: str, value: str, code: str) -> None:
    keys = {"at_mm": "[0.0, 0.0, 0.0]", "size_mm": "[1.0, 1.0, 1.0]", key: f"[1.0, {value}, 1.0]"}
    with pytest.raises(ConfigurationError, match=f"{code}: "):
        mill('[[body]]\nname = "a"\nshape = "box"\n' + "\n".join(map(" = ".join, keys.items())))
