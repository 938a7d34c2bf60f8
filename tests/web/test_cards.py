"""What the machine's page says, from states as a server sends them."""

from __future__ import annotations

import dataclasses
import time
from types import SimpleNamespace
from typing import Any, cast, get_args

import pytest
from mcclient import Event, Fault, Info, Machine, MachineStatus
from mcclient.types import (
    AxesStatus,
    AxisInfo,
    AxisTravel,
    Diagnostic,
    InputInfo,
    InputStatus,
    LineReport,
    ProgramStatus,
    SimulatedPath,
    SimulateReply,
    TipPath,
    ToolInfo,
    ToolPose,
    WorkOffset,
)

from mcserver.machine.dialect_section import Dialect
from mcserver.machine.machine_file import load_machine
from mcserver.net.status import axis_info
from mcserver.service.reports import BedMeshState
from mcserver.web.control import Control
from mcserver.web.jobs import path_from_line
from mcserver.web.link import MachineLink, joints_of
from mcserver.web.open_programs import refusal_of, who
from mcserver.web.panels.dry_run import report_html
from mcserver.web.panels.homing import phase_of
from mcserver.web.panels.messages import black_box_of, event_row
from mcserver.web.panels.people import people_html
from mcserver.web.panels.picture import tips_of
from mcserver.web.panels.positions import (
    MESHES,
    WHY,
    joint_html,
    mesh_text,
    offsets_html,
    positions_html,
    system_name,
)
from mcserver.web.signals import signals_of, value_of
from tests.wire_values import wire_value

AXES = wire_value(
    AxesStatus,
    index=(0, 7),
    position=(12.0, 90.0),
    setpoint=(12.5, 90.0),
    velocity=(3.0, 0.0),
    torque=(0.5, 0.0),
    state=("moving", "off"),
    homed=(True, False),
)
STATUS = wire_value(
    MachineStatus,
    t=5.0,
    wall=1000.0,
    instance="one",
    state="ready",
    axes=AXES,
    tools=(wire_value(ToolPose, 3, (1.0, 2.0, 3.0), (10.0, 20.0, 30.0)),),
    inputs=(InputStatus("door", 1.0),),
    work_offsets=(WorkOffset("G54", {"0": 10.0}), WorkOffset("G55", {"0": 99.0})),
)
INFO = wire_value(
    Info,
    machine="cell-1",
    server="0",
    protocol=(1,),
    instance="one",
    epoch=0.0,
    cycle_s=1e-3,
    axes=(wire_value(AxisInfo, 0, "linear", "mm", homing="switch"), wire_value(AxisInfo, 7, "rotary", "deg")),
    tools=(wire_value(ToolInfo, 3, "foot"),),
    inputs=(InputInfo("door", 0, "digital"),),
)


def link(**values: Any) -> MachineLink:
    """What panels read of a link."""
    known = {
        "name": "cell-1",
        "machine": None,
        "status": STATUS,
        "events": [],
        "clients": (),
        "visitors": {},
        "acts": [],
        "control": Control(lambda: 0.0),
        "jobs": SimpleNamespace(begun=[]),
    }
    return cast("MachineLink", SimpleNamespace(**{**known, **values}))


def event(kind: str, **values: Any) -> Event:
    t = values.pop("t", 5.0)
    return Event(**{"seq": 1, "t": t, "wall": t, "instance": "one", "kind": kind, **values})


def test_every_signal_of_a_machine_has_a_name_a_unit_and_a_value() -> None:
    signals = signals_of(INFO)
    values = {key: value_of(STATUS, key) for key in signals}
    assert None not in values.values()
    assert signals["axis 7 velocity"] == ("[7] velocity", "deg/s")
    assert values["axis 0 following error"] == 0.5
    assert values["axis 0 in G54"] == 2.0
    assert (values["tool 3 y"], values["tool 3 c"], values["input door"]) == (2.0, 30.0, 1.0)


@pytest.mark.parametrize("signal", ["axis 5 position", "tool 9 x", "input gone", "output gone", "nonsense"])
def test_a_signal_that_a_state_does_not_have_is_a_gap(signal: str) -> None:
    assert value_of(STATUS, signal) is None


async def test_a_further_letter_of_programs_stands_beside_an_axis() -> None:
    axes = load_machine("cartesian").axes[:2]
    dialect = Dialect(letters={"E": 1, "H": 1})
    info = SimpleNamespace(tools=(), axes=[axis_info(axis, dialect) for axis in axes])
    joints = await joints_of(cast("Machine", SimpleNamespace(info=info)))
    assert joints == {1: "E"}
    assert joint_html(joints, 1) == " <span class=mc-joint>E</span>"


def test_positions_are_shown_in_the_machine_and_in_g54() -> None:
    text = positions_html(STATUS, INFO, work=True)
    assert "<td class=n>12.000 mm</td><td class=n>2.000</td>" in text
    assert "off, not homed" in text
    assert "G54" not in positions_html(STATUS, INFO, work=False)
    assert "old" not in text


def test_values_of_a_drive_that_is_silent_are_marked_as_old() -> None:
    silent = [index == 1 for index in range(len(STATUS.axes.index))]
    axes = dataclasses.replace(STATUS.axes, silent=tuple(silent))
    text = positions_html(dataclasses.replace(STATUS, axes=axes), INFO, work=True)
    assert text.count("its drive is silent: old values") == text.count("<tr class=mc-old>") == 1
    assert [system_name(number) for number in (1, 6, 7, 9)] == ["G54", "G59", "G59.1", "G59.3"]


def test_each_work_offset_that_was_set_is_listed() -> None:
    text = offsets_html(STATUS, INFO)
    assert "<b>G54</b> reads zero at X 10.000 mm" in text
    assert (
        offsets_html(
            wire_value(MachineStatus, t=0.0, wall=0.0, instance="i", state="ready", axes=STATUS.axes), INFO
        )
        == ""
    )


def test_the_mesh_of_the_bed_that_counts_is_said_where_programs_probe_one() -> None:
    assert mesh_text(STATUS) == ""
    assert set(MESHES) == set(get_args(BedMeshState))
    assert "G29" in mesh_text(dataclasses.replace(STATUS, bed_mesh="probed"))


@pytest.mark.parametrize(
    ("state", "refused"), [("queued", True), ("held", True), ("paused", False), ("finished", False)]
)
def test_zero_is_refused_as_mcctl_refuses_it_while_a_program_is_open(state: str, refused: bool) -> None:
    programs = (
        wire_value(ProgramStatus, "p-1", "finished"),
        wire_value(ProgramStatus, "p-2", state, name="part.gcode", client="hmi"),
    )
    refusal = refusal_of(link(), programs, WHY)
    assert (refusal is not None) is refused
    if refusal is not None:
        assert refusal.code == "MC512"
        assert refusal.message == f"part.gcode of hmi is {state}: zero is set where the axes stand"


def test_a_program_of_this_page_is_named_by_its_person_and_never_by_the_page_s_id() -> None:
    job = SimpleNamespace(program="p-1", user="ann")
    here = link(machine=SimpleNamespace(client="web-1"), jobs=SimpleNamespace(begun=[job]))
    for client, name, person in (
        ("web-1", "part by ada.gcode", "this page"),
        ("web-1", "manual input by bob", "bob"),
        ("web-1", "jog axis 0 by cyd (browser 12ab)", "cyd (browser 12ab)"),
        ("hmi", "jog axis 0", "hmi"),
    ):
        assert who(here, wire_value(ProgramStatus, "p-2", "running", name=name, client=client)) == person
    mine = wire_value(ProgramStatus, "p-1", "running", name="part.gcode", client="web-1")
    assert who(here, mine) == "ann"


def test_what_an_earlier_start_of_a_server_has_said_is_not_what_is_so() -> None:
    server = SimpleNamespace(online=True, instance=STATUS.instance)
    assert MachineLink.online.fget(link(machine=server))
    server.instance = "the next"
    assert not MachineLink.online.fget(link(machine=server))
    assert MachineLink.online.fget(link(machine=server, status=None))


def test_zero_can_be_set_at_a_pause_whoever_waits_for_its_end() -> None:
    paused = wire_value(ProgramStatus, "p-1", "paused", name="part.gcode", client="hmi")
    waiting = wire_value(ProgramStatus, "p-2", "queued", name="next.gcode", client="hmi")
    jog = wire_value(ProgramStatus, "p-3", "running", name="jog axis 0", client="hmi")
    assert refusal_of(link(), (paused, waiting), WHY) is None
    assert refusal_of(link(), (paused, waiting, jog), WHY) is not None


def test_homing_says_what_it_is_at_only_while_its_program_runs() -> None:
    searching = [event("axis.homing", axis=0, message="searching the switch", program="h1")]
    running = wire_value(
        MachineStatus,
        t=5.0,
        wall=0.0,
        instance="one",
        state="ready",
        axes=AXES,
        programs=(wire_value(ProgramStatus, "h1", "running"),),
    )
    assert phase_of(link(events=searching, status=running), 0, homed=False) == "searching the switch"
    assert phase_of(link(events=searching), 0, homed=False) == "not homed"
    done = [*searching, event("axis.homed", axis=0, program="h1")]
    assert phase_of(link(events=done, status=running), 0, homed=True) == "homed"


def test_a_fault_leads_to_the_black_box_that_was_written_after_it() -> None:
    status = wire_value(
        MachineStatus,
        t=9.0,
        wall=0.0,
        instance="one",
        state="fault",
        axes=AXES,
        faults=(Fault("MC407", "late", t=6.0),),
    )
    older = event("recording", t=3.0, message="blackbox-1-MC407")
    asked = event("recording", t=7.0, message="mine")
    newer = event("recording", t=8.0, message="blackbox-2-MC407")
    assert black_box_of(link(events=[older, asked]), status) == ""
    assert black_box_of(link(events=[older, asked, newer]), status) == "blackbox-2-MC407"
    assert black_box_of(link(events=[newer]), STATUS) == ""


def test_a_fault_leads_to_no_black_box_of_an_earlier_start() -> None:
    status = MachineStatus(
        t=9.0,
        wall=0.0,
        instance="two",
        state="fault",
        axes=AXES,
        programs=(),
        faults=(Fault("MC407", "late", t=6.0),),
    )
    before = event("recording", t=3600.0, message="blackbox-1-MC407")
    own = event("recording", t=8.0, instance="two", message="blackbox-2-MC407")
    assert black_box_of(link(events=[before]), status) == ""
    assert black_box_of(link(events=[before, own]), status) == "blackbox-2-MC407"


def test_an_event_of_before_a_restart_is_shown_at_the_time_when_it_happened() -> None:
    resumed = event("program.resumed", t=3600.0, wall=1_773_489_600.0)
    shown = time.strftime("%H:%M:%S", time.localtime(1_773_489_600.0))
    assert f"<div>{shown} <b>program.resumed</b>" in event_row(resumed)


def test_people_are_listed_with_what_they_hold_and_nobody_s_name_is_markup() -> None:
    program = wire_value(ProgramStatus, "p1", "running", client="<b>eve</b>", name="a.nc", axes=(0, 7))
    status = wire_value(
        MachineStatus, t=5.0, wall=0.0, instance="one", state="ready", axes=AXES, programs=(program,)
    )
    commands = [
        event("command", client="web-1", reason="hold"),
        event("command", client="bob", reason="abort"),
    ]
    shown = link(
        machine=SimpleNamespace(client="web-1"),
        clients=("bob",),
        visitors={"ada": 2},
        acts=[(4.0, "ada", "hold")],
        events=commands,
    )
    text = people_html(shown, status)
    assert "<b>&lt;b&gt;eve&lt;/b&gt;</b>: a.nc holds X, [7] (running)" in text
    assert "<b>web-1</b> (this page): holds no axis" in text
    assert "ada (2)" in text
    assert text.index("abort") < text.index("</b> hold")
    # what was done here is named by who did it, not by the page's own client
    assert text.count("hold</div>") == 1


def test_tips_are_the_tools_or_the_first_axes() -> None:
    assert tips_of(STATUS) == {"T3": [1.0, 2.0, 3.0]}
    plain = wire_value(MachineStatus, t=5.0, wall=0.0, instance="one", state="ready", axes=AXES)
    assert tips_of(plain) == {"": [12.0, 0.0, 0.0]}


def test_a_path_from_a_line_on_leaves_out_what_comes_before() -> None:
    path = SimulatedPath((0, 2, 3, 3), (TipPath(None, ((0.0,), (1.0,), (2.0,), (3.0,))),))
    assert path_from_line(path, 3) == {"lines": [3, 3], "tips": [{"tool": None, "points": [(2.0,), (3.0,)]}]}
    assert path_from_line(path, 1)["lines"] == [0, 2, 3, 3]


def test_a_dry_run_says_duration_travel_slow_lines_and_faults() -> None:
    lines = (
        wire_value(LineReport, 7, stretched_by=2.0, bound_by="axis 2 acceleration"),
        wire_value(LineReport, 8, stretched_by=1.0),
    )
    axes = {"0": AxisTravel(5.0, 0.0, 10.0, "mm"), "1": AxisTravel(0.0, 0.0, 0.0, "mm")}
    text = report_html("", wire_value(SimulateReply, True, 65.0, 100.0, lines, axes))
    assert "1:05" in text
    assert "line 7: 2.00 × its time, axis 2 acceleration" in text
    assert "<td>X</td>" in text
    assert "<td>Y</td>" not in text
    fault = Diagnostic("MC104", "<no>", 1, hint="h")
    refused = report_html("G02 R1", wire_value(SimulateReply, False, 65.0, diagnostics=(fault,)))
    assert "&lt;no&gt; [MC104]" in refused
    assert "1:05" not in refused
