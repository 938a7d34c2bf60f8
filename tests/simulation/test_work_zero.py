"""Work offsets that a check or a simulation starts with (`--zero`)."""

from __future__ import annotations

from pathlib import Path

import pytest

from mcserver.cli.app import run_command_line
from mcserver.errors import UsageFault
from mcserver.gcode.program_check import check_program
from mcserver.machine.machine_file import load_machine
from mcserver.simulation.work_zero import with_zeros

FILE = str(Path(__file__).parents[1] / "corpus" / "cnc.toml")
MILL = load_machine(FILE)


def test_zeros_are_read_by_system_axis_and_unit() -> None:
    machine = with_zeros(MILL, ["X=10, y=-20.5", "G55:[2]=3", "A=180"])
    systems = machine.dialect.systems
    assert systems[1] == pytest.approx({0: 0.01, 1: -0.0205, 3: 3.141592653589793})
    assert systems[2] == pytest.approx({2: 0.003})
    assert with_zeros(MILL, []) is MILL


@pytest.mark.parametrize("entry", ["X", "X=", "X=ten", "X=nan", "Q=1", "G60:X=1", "9=1", "X=1=2", ""])
def test_what_is_no_zero_of_an_axis_is_refused(entry: str) -> None:
    with pytest.raises(UsageFault, match="MC017"):
        with_zeros(MILL, [entry])


def test_the_reference_s_dialect_has_no_zeros() -> None:
    with pytest.raises(UsageFault, match="no work offsets"):
        with_zeros(load_machine("cartesian"), ["X=10"])


def test_a_limit_passed_names_the_zero_in_force() -> None:
    (fault,) = check_program("G1 X100 F1000", with_zeros(MILL, ["X=450"]))
    assert fault.code == "MC201"
    assert "the program's zero lies at 450 mm" in fault.hint
    (plain,) = check_program("G1 X900 F1000", MILL)
    assert "zero" not in plain.hint


def test_check_takes_zeros(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    program = tmp_path / "part.nc"
    program.write_text("G1 X100 F1000\n")
    assert run_command_line(["check", str(program), "-m", FILE, "--zero", "X=300"]) == 0
    assert run_command_line(["check", str(program), "-m", FILE, "--zero", "X=450"]) == 4
    assert "MC201" in capfd.readouterr().err
