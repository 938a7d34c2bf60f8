"""What `check_machine` finds between a machine file and its URDF."""

from __future__ import annotations

from pathlib import Path

import pytest
from mckinematics.solution_check import check_machine

from mcserver.machine.machine_file import BUILT_IN, load_machine, parse_machine
from tests.kinematics.tool_machines import Joint, Y, Z, chain_machine, chain_urdf, machine_text

ARM = (Joint("revolute", "0 0 0.2", Z, -2.0, 2.0), Joint("revolute", "0 0 0.1", Y, -1.0, 1.0))


@pytest.mark.parametrize("name", BUILT_IN)
def test_built_in_machines_fit(name: str) -> None:
    assert check_machine(load_machine(name)) == ()


def test_a_machine_that_fits_has_no_findings(tmp_path: Path) -> None:
    assert check_machine(chain_machine(tmp_path, ARM)) == ()


def test_a_missing_urdf_is_found(tmp_path: Path) -> None:
    machine = parse_machine(machine_text("none.urdf", ['frame = "tip"\naxes = [0]'], 1), folder=tmp_path)
    (finding,) = check_machine(machine)
    assert finding.code == "MC301"
    assert "none.urdf" in finding.message
    assert finding.hint


def test_the_faults_of_all_tools_are_found_together(tmp_path: Path) -> None:
    (tmp_path / "chain.urdf").write_text(chain_urdf(ARM), "utf-8")
    tools = ['frame = "top"\naxes = [0, 1]', 'frame = "tip"\naxes = [0]', 'frame = "tip"\naxes = [0, 1]']
    machine = parse_machine(machine_text("chain.urdf", tools, 2), folder=tmp_path)
    findings = check_machine(machine)
    assert [finding.tool for finding in findings] == [1, 2]
    assert "tip" in findings[0].hint
    assert "joint0, joint1" in findings[1].message


def test_a_start_outside_the_limits_of_the_urdf_is_found(tmp_path: Path) -> None:
    (finding,) = check_machine(chain_machine(tmp_path, ARM, start={1: 80.0}))
    assert finding.severity == "error"
    assert finding.axis == 1
    assert "starts at 80 deg" in finding.message
    assert "57.296 deg" in finding.message


def test_a_singular_start_is_a_warning(tmp_path: Path) -> None:
    leg = (Joint("revolute", "0 0 0", Z), Joint("revolute", "0.4 0 0", Z))
    (finding,) = check_machine(chain_machine(tmp_path, leg))
    assert finding.severity == "warning"
    assert "singular" in finding.message
