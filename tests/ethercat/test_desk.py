"""`mcserver drives` on EtherCAT: parameters by the mailbox, only where nobody else is master of the line."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from mcserver.cli.app import run_command_line
from mcserver.drives.bus import DriveMode, DriveState
from tests.canopen.esi_files import PRODUCT, VENDOR, device, esi
from tests.ethercat.conftest import Start
from tests.ethercat.rig import Namespace, SimulatedLine, line_of

Capture = pytest.CaptureFixture[str]


@pytest.fixture
def file(tmp_path: Path) -> str:
    path = tmp_path / "desk.toml"
    path.write_text(line_of(2))
    return str(path)


def drives(namespace: Namespace, *words: str) -> int:
    with namespace.entered():
        return run_command_line(["drives", *words])


def test_a_parameter_is_read_written_and_backed_up_by_the_mailbox(
    namespace: Namespace,
    simulate: Callable[[str], SimulatedLine],
    file: str,
    tmp_path: Path,
    capsys: Capture,
) -> None:
    simulate(line_of(2))
    assert drives(namespace, "read", "1", "1008", "6065", "-m", file, "--json") == 0
    shown = json.loads(capsys.readouterr().out)["values"]
    assert [each["value"] for each in shown] == ["Simulated servo drive", 0xFFFFFFFF]
    assert drives(namespace, "write", "1", "6065", "5000", "-m", file) == 0
    assert drives(namespace, "save", "1", "-m", file) == 0
    copy = str(tmp_path / "copy.toml")
    assert drives(namespace, "backup", "1", "-o", copy, "-m", file) == 0
    assert drives(namespace, "restore", "0", copy, "-m", file) == 0
    assert drives(namespace, "compare", "0", "1", "-m", file) == 0
    assert drives(namespace, "units", "0", "--pitch", "10", "-m", file) == 0


def test_a_drive_of_an_esi_file_has_its_objects_by_name_and_moves(
    namespace: Namespace, start: Start, tmp_path: Path, capsys: Capture
) -> None:
    esi_file = tmp_path / "drive.xml"
    esi_file.write_text(esi(device(revision=0x20001)))
    keys = f'eds = "{esi_file}"\nvendor_id = {VENDOR}\nproduct_code = {PRODUCT}'
    line, cycle = start(2, drive=keys)
    cycle.command(DriveMode.POSITION, DriveState.ENERGIZED)
    cycle.setpoints.position[:] += 0.0001
    cycle.run(50)
    assert line.control.state(2)["position"] == pytest.approx(0.0101 / 0.01 * 65536, abs=100)
    cycle.close()
    machine = str(tmp_path / "line.toml")
    assert drives(namespace, "write", "1", "brake delay", "9", "-m", machine) == 0
    capsys.readouterr()
    assert drives(namespace, "read", "1", "brake delay", "-m", machine, "--json") == 0
    shown = json.loads(capsys.readouterr().out)["values"]
    assert [each["value"] for each in shown] == [9]


def test_a_running_master_is_not_disturbed(
    start: Start, namespace: Namespace, file: str, capsys: Capture
) -> None:
    _, cycle = start(2)
    cycle.run_beside(lambda: drives(namespace, "read", "0", "1008", "-m", file), wanted=1)
    assert "MC560" in capsys.readouterr().err
    assert not cycle.feedback.fault.any()


def test_an_abort_and_an_object_that_moves_are_refused_by_name(
    namespace: Namespace, simulate: Callable[[str], SimulatedLine], file: str, capsys: Capture
) -> None:
    simulate(line_of(1))
    assert drives(namespace, "read", "0", "60B0", "-m", file) == 1
    assert "MC553" in capsys.readouterr().err
    assert drives(namespace, "write", "0", "6040", "15", "-m", file) == 1
    assert "MC559" in capsys.readouterr().err


def test_a_drive_is_listed_by_its_position(file: str, capsys: Capture) -> None:
    assert run_command_line(["drives", "list", "-m", file]) == 0
    assert "position 1" in capsys.readouterr().out


def test_a_scope_and_the_health_of_a_line_are_taken_beside_its_master(
    start: Start, namespace: Namespace, file: str, capsys: Capture, tmp_path: Path
) -> None:
    line, cycle = start(2)
    cycle.command(DriveMode.POSITION, DriveState.ENERGIZED)
    step = 1e-5
    cycle.setpoints.velocity[:] = step / cycle.machine.cycle_s

    def beside(*words: str) -> Any:
        thread_codes: list[int] = []
        thread = threading.Thread(target=lambda: thread_codes.append(drives(namespace, *words, "--json")))
        thread.start()

        def ended() -> bool:
            cycle.setpoints.position[:] += step
            return not thread.is_alive()

        cycle.until(ended, "the end of the command")
        assert thread_codes == [0]
        return json.loads(capsys.readouterr().out)

    scope = beside("scope", "1", "--seconds", "0.5", "-o", str(tmp_path / "x.mcap"), "-m", file)
    signals = {each["object"]: each for each in scope["signals"]}
    assert scope["cycles"] == 50
    # 0.01 mm a cycle
    assert signals["607Ah:00"]["greatest"] - signals["607Ah:00"]["least"] == pytest.approx(0.49, abs=0.02)
    assert signals["6064h:00"]["greatest"] - signals["6064h:00"]["least"] == pytest.approx(0.48, abs=0.04)
    assert abs(signals[""]["greatest"]) < 0.03
    line.control.fault(2, "mute")
    (bus,) = beside("health", "--seconds", "0.5", "-m", file)["buses"]
    assert bus["master"]
    assert [node["node"] for node in bus["counts"]["nodes"]] == [0, 1]
    # one frame carries both drives: each that came back short is lost for both, however many there were
    assert bus["error_frames"] > 0
    assert min(node["lost"] for node in bus["counts"]["nodes"]) > 0
    assert 0.0 < bus["counts"]["load"] < 0.05


def test_a_line_without_a_master_says_what_its_slaves_have_counted(
    namespace: Namespace, simulate: Callable[[str], SimulatedLine], file: str, capsys: Capture
) -> None:
    simulate(line_of(2))
    assert drives(namespace, "health", "--seconds", "0.3", "-m", file, "--json") == 0
    (bus,) = json.loads(capsys.readouterr().out)["buses"]
    assert not bus["master"]
    for axis in ("0", "1"):
        assert bus["drives"][axis]["status"] == "switch on disabled"
        assert bus["drives"][axis]["line_errors"]["lost links"] == [0, 0, 0, 0]
