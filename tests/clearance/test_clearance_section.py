"""Bodies and zones that a machine file names, and the mistakes in them."""

from __future__ import annotations

from pathlib import Path

import pytest

from mcserver.clearance.scene import Scene
from mcserver.errors import ConfigurationError
from mcserver.machine.section_reader import MachineFileRejected
from tests.clearance.machines import VISE, arm, mill


def test_a_machine_file_without_bodies_has_no_clearance() -> None:
    assert arm().clearance is None


@pytest.mark.parametrize(
    ("sections", "message"),
    [
        (VISE + VISE, "'vise' is there twice"),
        ('[[body]]\nname = "a"\nshape = "cone"\n', 'body[1].shape: "cone" is not one of "box"'),
        ('[[body]]\nname = "a"\nshape = "sphere"\nradius_mm = 0.0\n', "radius_mm"),
        (
            '[[body]]\nname = "a"\nshape = "sphere"\nradius_mm = 1.0\ncarried_by = [7]\n',
            "axis 7 is not one of the linear axes X, Y, Z",
        ),
        (
            '[[body]]\nname = "a"\nshape = "sphere"\nradius_mm = 1.0\nlink = "flange"\ncarried_by = [0]\n',
            "a link carries it already",
        ),
        ('[[zone]]\nname = "a"\nkind = "fast"\nsize_mm = [1.0, 1.0, 1.0]\n', "is not one of"),
        ("[clearance]\nmargin_mm = -1.0\n", "margin_mm"),
    ],
)
def test_a_mistake_is_named_with_its_place(sections: str, message: str) -> None:
    with pytest.raises(MachineFileRejected) as refused:
        mill(sections)
    assert message in str(refused.value)


@pytest.mark.parametrize(
    ("sections", "message", "hint"),
    [
        ('[clearance]\nallowed = [["tool", "vice"]]\n' + VISE, "no body 'vice'", "'vise'"),
        ('[[zone]]\nname = "z"\nsize_mm = [1.0, 1.0, 1.0]\nbodies = ["tol"]\n', "no body 'tol'", "'tool'"),
        (
            '[[body]]\nname = "a"\nshape = "sphere"\nradius_mm = 1.0\nlink = "flange"\n',
            "no URDF",
            "carried_by",
        ),
        ('[[body]]\nname = "a"\nshape = "mesh"\nfile = "nowhere.stl"\n', "cannot be read", "STL"),
        ('[clearance]\nsrdf = "nowhere.srdf"\n' + VISE, "SRDF", "another file"),
        ("[clearance]\n", "no two bodies", "[[zone]]"),
    ],
)
def test_what_only_the_model_can_tell_is_refused(sections: str, message: str, hint: str) -> None:
    with pytest.raises(ConfigurationError) as refused:
        Scene(mill(sections))
    assert refused.value.code == "MC323"
    assert message in refused.value.message
    assert hint in refused.value.hint


def test_a_link_that_is_not_there_is_refused_with_the_nearest() -> None:
    with pytest.raises(ConfigurationError) as refused:
        Scene(arm('[[body]]\nname = "a"\nshape = "sphere"\nradius_mm = 1.0\nlink = "flang"\n'))
    assert "flange" in refused.value.hint


def test_pairs_of_the_srdf_and_of_allowed_may_touch(tmp_path: Path) -> None:
    names = {pair.names for pair in Scene(arm("[clearance]\n")).pairs}
    assert ("forearm", "flange") in names
    srdf = tmp_path / "arm.srdf"
    srdf.write_text('<robot name="arm6"><disable_collisions link1="flange" link2="forearm"/></robot>')
    fewer = {pair.names for pair in Scene(arm(f'[clearance]\nsrdf = "{srdf}"\n')).pairs}
    assert names - fewer == {("forearm", "flange")}
    fewer = {pair.names for pair in Scene(arm('[clearance]\nallowed = [["base", "wrist"]]\n')).pairs}
    assert names - fewer == {("base", "wrist")}


def test_links_that_a_joint_connects_are_no_pair_and_what_stands_is_none_with_the_base() -> None:
    wall = '[[body]]\nname = "wall"\nshape = "box"\nsize_mm = [10.0, 10.0, 10.0]\n'
    names = {pair.names for pair in Scene(arm(wall)).pairs}
    assert ("base", "turret") not in names
    assert ("base", "wall") not in names
    assert ("turret", "wall") in names


def test_bodies_do_not_need_a_section_of_their_own() -> None:
    machine = mill(VISE)
    assert machine.clearance is not None
    assert machine.clearance.margin == pytest.approx(1e-3)
