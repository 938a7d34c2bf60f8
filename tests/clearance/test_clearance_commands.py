"""Clearance in the commands: a report, a picture, a machine check, and what an approval rests on."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from mcp import Client

from mcserver.clearance.outlines import standing_outlines
from mcserver.cli.app import run_command_line
from mcserver.language.agents.server import AgentTools, build_server
from mcserver.machine.machine_digest import machine_digest
from mcserver.machine.machine_file import load_machine, parse_machine
from mcserver.planning.start_state import StartState
from mcserver.simulation.preview import preview
from tests.clearance.machines import MILL, TOOL, VISE, block, mill
from tests.cli.command import EXAMPLES

Capture = pytest.CaptureFixture[str]
ARM = str(EXAMPLES / "post-and-door.toml")
PROGRAM = str(EXAMPLES / "clearance.gcode")


def test_a_simulation_ends_with_the_contact_and_the_least_clearance(capfd: Capture) -> None:
    assert run_command_line(["simulate", PROGRAM, "--machine", ARM]) == 1
    shown = capfd.readouterr()
    assert "least clearance 4.9" in shown.out
    assert "MC320" in shown.err
    assert "'post'" in shown.err


def test_its_report_names_pairs(capfd: Capture) -> None:
    assert run_command_line(["simulate", PROGRAM, "--machine", ARM, "--json"]) == 1
    report = json.loads(capfd.readouterr().out)
    assert report["clearance"]["pairs"][0]["bodies"] == ["flange", "post"]
    assert report["clearance"]["least_mm"] < report["clearance"]["margin_mm"] == 5.0
    assert [each["code"] for each in report["diagnostics"]] == ["MC320"]


def test_a_picture_is_drawn_of_a_run_with_a_contact(tmp_path: Path, capfd: Capture) -> None:
    output = tmp_path / "run.png"
    assert run_command_line(["plot", PROGRAM, "--machine", ARM, "--output", str(output)]) == 1
    assert output.read_bytes().startswith(b"\x89PNG")
    assert "MC320" in capfd.readouterr().err


def test_a_check_finds_what_a_simulation_finds(capfd: Capture) -> None:
    assert run_command_line(["check", PROGRAM, "--machine", ARM, "--json"]) == 4
    checked = json.loads(capfd.readouterr().out)["diagnostics"]
    assert run_command_line(["simulate", PROGRAM, "--machine", ARM, "--json"]) == 1
    assert checked == json.loads(capfd.readouterr().out)["diagnostics"]


def test_a_check_says_that_there_are_no_contacts_where_a_machine_has_bodies(
    tmp_path: Path, capfd: Capture
) -> None:
    machine, program = tmp_path / "mill.toml", tmp_path / "a.gcode"
    machine.write_text("\n".join((MILL, TOOL, VISE)))
    program.write_text("G1010\nG1 Z60 F6000\nG1 X150\n")
    assert run_command_line(["check", str(program), "--machine", str(machine)]) == 0
    assert "no faults and no contacts" in capfd.readouterr().out
    # what is rejected is not run
    program.write_text("G1010\nG1 Z20 F6000\nG1 X150\nG77\n")
    assert run_command_line(["check", str(program), "--machine", str(machine)]) == 4
    assert "MC320" not in capfd.readouterr().err


def test_a_check_says_where_a_run_ends_that_waits_for_an_input(tmp_path: Path, capfd: Capture) -> None:
    machine, program = tmp_path / "mill.toml", tmp_path / "a.gcode"
    door = '[[input]]\nname = "door"\nkind = "digital"\nnumber = 0\n'
    machine.write_text("\n".join((MILL, TOOL, VISE, door)))
    program.write_text("G1010\nM66 P0 L3 Q1\nG1 Z20 F6000\nG1 X150\n")
    assert run_command_line(["check", str(program), "--machine", str(machine), "--json"]) == 0
    [early] = json.loads(capfd.readouterr().out)["diagnostics"]
    assert (early["severity"], early["line"]) == ("warning", 2)
    assert "up to here alone" in early["message"]
    assert run_command_line(["check", str(program), "--machine", str(machine)]) == 0
    shown = capfd.readouterr().out
    assert "no faults" in shown
    assert "no contacts" not in shown


@pytest.mark.parametrize(
    ("section", "code", "severity", "exit_code"),
    [
        (block("lump", (0.0, 0.0, 120.0), 10.0), "MC320", "warning", 0),
        ('[[body]]\nname = "a"\nshape = "mesh"\nfile = "no.stl"\n', "MC323", "error", 3),
    ],
)
def test_a_machine_check_builds_the_bodies(
    section: str, code: str, severity: str, exit_code: int, tmp_path: Path, capfd: Capture
) -> None:
    path = tmp_path / "mill.toml"
    path.write_text("\n".join((MILL, TOOL, section)))
    assert run_command_line(["machine", "check", str(path), "--json"]) == exit_code
    found = json.loads(capfd.readouterr().out)["diagnostics"]
    assert [(each["code"], each["severity"]) for each in found if each["code"].startswith("MC32")] == [
        (code, severity)
    ]


def test_a_server_does_not_start_with_bodies_that_do_not_fit(tmp_path: Path, capfd: Capture) -> None:
    path = tmp_path / "mill.toml"
    path.write_text("\n".join((MILL, TOOL, '[clearance]\nallowed = [["tool", "vice"]]\n', VISE)))
    assert run_command_line(["run", "--machine", str(path)]) == 3
    assert "MC323" in capfd.readouterr().err


def test_a_machine_is_what_its_files_contain_in_whichever_folder(tmp_path: Path) -> None:
    text = MILL + '[kinematics]\nurdf = "a.urdf"\n[clearance]\nsrdf = "a.srdf"\n'
    text += '[[body]]\nname = "a"\nshape = "mesh"\nfile = "vise.stl"\n'
    files = {
        "a.urdf": '<robot name="a"><link name="l"><visual><geometry>'
        '<mesh filename="package://looks/link.stl"/></geometry></visual></link></robot>',
        "a.srdf": "<robot/>",
        "vise.stl": "solid",
        "looks/link.stl": "solid",
    }

    def digest(folder: str, **others: str) -> str:
        for name, content in {**files, **others}.items():
            (tmp_path / folder / name).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / folder / name).write_text(content)
        return machine_digest(parse_machine(text, folder=tmp_path / folder))

    one = digest("one")
    assert digest("another/place") == one
    assert len({one, *(digest("one", **{name: files[name] + " "}) for name in files)}) == 1 + len(files)


def test_what_stands_has_an_outline_and_what_is_carried_none() -> None:
    clearance = load_machine(ARM).clearance
    assert clearance is not None
    outlines = {each.name: each for each in standing_outlines(clearance)}
    assert outlines.keys() == {"table", "post", "door"}
    assert outlines["post"].corners.max(axis=0) == pytest.approx([525.0, 85.0, 500.0])
    assert outlines["door"].zone


def test_a_run_with_a_contact_cannot_be_approved() -> None:
    machine = mill(VISE)
    axes = tuple(axis.index for axis in machine.axes)
    hit = preview("G1010\nG1 Z20 F6000\nG1 X150\n", machine, StartState.of(machine), axes)
    assert hit.marks is None
    assert hit.envelope is None
    assert [each["code"] for each in hit.report["diagnostics"]] == ["MC320"]
    clear = preview("G1010\nG1 Z60 F6000\nG1 X150\n", machine, StartState.of(machine), axes)
    assert clear.marks is not None


@pytest.mark.timeout(400)
async def test_agents_are_shown_a_run_with_a_contact() -> None:
    async with Client(build_server(AgentTools(load_machine(ARM), ARM))) as client:
        text = Path(PROGRAM).read_text("utf-8")
        result = await client.call_tool("simulate", {"text": text, "picture": True})
    report = result.structured_content
    assert report is not None
    assert not report["ok"]
    assert report["clearance"]["least_mm"] < 5.0
    assert [each.type for each in result.content] == ["text", "image"]
