"""Attacks on an approval: what a person armed runs as it was looked at, or not at all.

Real planning and a real executor on a virtual clock; nothing is faked but time.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from mcserver.errors import ServiceError
from mcserver.machine.machine_file import parse_machine
from mcserver.net import arming_messages as wire
from mcserver.planning.start_state import StartState
from mcserver.service.approach import Confirmation
from mcserver.service.homing import HomingService
from mcserver.service.program_options import ProgramOptions
from mcserver.simulation.preview import Preview
from tests.net.approval_site import ANNA, BOT, MILL, SHIFT, TEXT, Site


async def test_a_run_that_was_armed_stays_as_it_was_shown(site: Site) -> None:
    armed = await site.arm()
    assert (armed.extents[0].low, armed.extents[0].high) == pytest.approx((0.0, 50.0))
    assert armed.extents[0].speed == pytest.approx(100.0, rel=1e-3)
    program = await site.run()
    assert program.state == "finished", program.fault
    assert site.extent() == pytest.approx((0.0, 50.0))


async def test_another_armed_program_that_moves_the_work_zero_voids_the_approval(site: Site) -> None:
    """The attack that was seen: A shifts G54 and moves nothing, B goes on from there."""
    shifting = await site.arm(SHIFT + "\nG0 X0")
    assert "moves G54 X by 300 mm" in shifting.effects
    await site.arm()
    await site.run(SHIFT + "\nG0 X0")
    message = await site.refusal()
    assert "G54 X moved by 300 mm" in message
    assert site.extent()[1] <= 300.1


async def test_what_is_no_longer_as_it_was_simulated_is_shown_and_not_armed(site: Site) -> None:
    run = await site.ask()
    await site.by_hand(SHIFT, "G0 X0 Y0 Z0", "G10 L2 P1 X0")
    await site.by_hand("G0 X0 Y0 Z0", "G10 L2 P1 X300")
    (shown,) = site.arming.run_requests(ANNA, wire.RunRequestsRequest()).requests
    assert "G54 X moved by 300 mm" in shown.changed
    with pytest.raises(ServiceError, match="MC572: "):
        site.arming.arm(ANNA, wire.ArmRequest(sha256=run.sha256))


async def test_what_a_program_shifts_is_named_though_it_moves_nothing(site: Site) -> None:
    run = await site.ask(SHIFT + "\nG0 Y0")
    assert run.effects[0] == "moves G54 X by 300 mm"


async def test_a_person_who_moves_an_axis_voids_it_and_moving_it_back_does_not(site: Site) -> None:
    await site.by_hand("G0 X1")
    await site.by_hand("G0 X0")
    await site.arm()
    await site.by_hand("G0 X5")
    assert "X stands 5 mm from where it was" in await site.refusal()
    await site.by_hand("G0 X0")
    assert (await site.run()).state == "finished"


@pytest.mark.parametrize(
    ("text", "by_hand", "words"),
    [
        (TEXT, ["G10 L20 P2 Y7"], "G55 Y moved by -7 mm"),
        ("T2 M6\nG43 H2\nG1 Z-5 F600", ["G10 L1 P2 Z45"], "T2 length moved by 15 mm"),
        (TEXT, ["G38.3 Z-20 F600", "G10 L20 P1 Z0", "G0 X0 Y0", "G53 G0 Z0"], "G54 Z moved by -20 mm"),
    ],
    ids=["offset", "tool", "probe"],
)
async def test_what_a_person_sets_meanwhile_voids_an_approval_and_is_named(
    site: Site, text: str, by_hand: list[str], words: str
) -> None:
    await site.by_hand("G0 X0 Y0 Z0")
    await site.arm(text)
    await site.by_hand(*by_hand)
    assert words in await site.refusal(text)


async def test_a_reference_that_is_given_anew_voids_an_approval_though_every_number_is_as_it_was(
    tmp_path: Path,
) -> None:
    site = Site(parse_machine(MILL.replace("index = 0", 'index = 0\nhoming.method = "manual"', 1)), tmp_path)
    homing = HomingService(site.cell.service)
    await homing.reference(ANNA, {0: 0.0})
    await approve(site)
    # told the same once more
    await homing.reference(ANNA, {0: 0.0})
    assert (await site.run()).state == "finished"
    assert (await site.ask()).state == "armed"
    await site.by_hand("G0 X100")
    await homing.reference(ANNA, {0: 0.0})
    assert "X has another reference" in await site.refusal()
    # its extents are elsewhere, too
    assert "X has another reference" in (await site.ask("G1 X30 F3000")).beyond
    await site.cell.stop()


async def test_another_override_than_was_allowed_does_not_count(site: Site) -> None:
    text = "G1 X50 F1200\nG1 X0"
    await site.arm(text, override=50.0)
    site.cell.service.set_override(2.0, None)
    program = await site.start(text)
    site.cell.service.set_override(2.0, program.program)
    site.cell.service.set_override(1.5, None)
    await site.cell.ended(program)
    assert program.state == "finished", program.fault
    speed = np.abs(np.diff(np.array(site.rows)[:, 0])).max() / 1e-3
    assert speed <= 0.0101


async def test_an_input_that_the_program_reads_is_named_and_one_that_it_does_not_read_is_not(
    site: Site,
) -> None:
    text = "M66 P0 L3 Q1\nG1 X20 F6000"
    await site.by_hand("G0 X0 Y0 Z0")
    await site.arm(text)
    site.cell.service.channels.set_input("part there", value=False)
    site.cell.service.channels.set_input("door", value=True)
    await site.cell.until(lambda: site.cell.service.port.snapshot().inputs == [0.0, 1.0, 0.0])
    message = await site.refusal(text)
    assert 'the input "part there" was 1 and is 0' in message
    assert "door" not in message


async def test_an_output_that_was_switched_is_named(site: Site) -> None:
    await site.arm()
    site.cell.service.set_output("clamp", value=True)
    await site.cell.until(lambda: site.cell.service.port.snapshot().outputs == [1.0])
    assert 'the output "clamp" was 0 and is 1' in await site.refusal()


async def test_a_program_that_switches_says_so_on_its_card(site: Site) -> None:
    run = await site.ask("M64 P0\nG1 X20 F6000")
    assert 'leaves the output "clamp" on' in run.effects
    assert "leaves X energized" in run.effects


async def test_a_tool_length_of_another_machine_file_is_another_approval(site: Site, tmp_path: Path) -> None:
    text = "T2 G43 H2\nG1 Z10 F6000"
    before = await site.arm(text)
    await site.cell.stop()
    again = Site(parse_machine(MILL.replace("length_mm = 30.0", "length_mm = 130.0")), tmp_path, "second")
    try:
        # an approval is of one start of one machine: nothing is armed any more
        with pytest.raises(ServiceError, match="MC571: "):
            await again.start(text)
        after = await again.ask(text)
        assert after.digest != before.digest
        assert after.extents[0].high == pytest.approx(before.extents[0].high + 100.0)
    finally:
        await again.cell.stop()


async def test_a_restart_alone_ends_an_approval(site: Site, tmp_path: Path) -> None:
    before = await site.arm()
    await site.cell.stop()
    again = Site(site.machine, tmp_path, "second")
    try:
        with pytest.raises(ServiceError, match="MC571: "):
            await again.start()
        # the same text, from the same state, on the same machine
        assert (await again.ask()).digest == before.digest
    finally:
        await again.cell.stop()


async def test_an_emergency_stop_ends_an_approval(site: Site) -> None:
    await site.arm()
    site.cell.service.latch.emergency_stop(ANNA, "")
    site.cell.service.reset(None)
    with pytest.raises(ServiceError, match="MC571: "):
        await site.start()


async def test_a_client_that_goes_while_its_run_is_simulated_leaves_no_request(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulate = site.preview

    async def gone(client: str, text: str, start: StartState, axes: tuple[int, ...]) -> Preview:
        site.cell.service.absences.gone(client)
        return await simulate(client, text, start, axes)

    monkeypatch.setattr(site, "preview", gone)
    with pytest.raises(ServiceError, match="MC570: "):
        await site.ask()
    monkeypatch.setattr(site, "preview", simulate)
    assert site.arming.run_requests(ANNA, wire.RunRequestsRequest()).requests == []
    # its successor, and the same client come back, may ask
    await site.ask(client="bot.agent-2")


async def test_holds_and_resumes_and_what_others_do_meanwhile_do_not_open_the_envelope(site: Site) -> None:
    text = "G1 X150 F3000\nG1 X0"
    await site.arm(text)
    program = await site.start(text)
    service = site.cell.service
    for turn in range(12):
        await site.cell.until(lambda turn=turn: len(site.rows) > 200 * turn or program.ended)
        service.hold(program.program)
        service.set_override(0.3 + 0.1 * turn, program.program)
        with pytest.raises(ServiceError):
            # a program that is not stepped is not stepped by anybody
            service.step(BOT, program.program)
        service.resume(program.program)
    await site.cell.ended(program)
    assert site.extent()[1] <= 150.0 + 0.1
    assert program.state == "finished", program.fault


async def test_an_armed_program_that_is_gone_on_with_keeps_its_envelope_and_its_override(site: Site) -> None:
    text = "G1 X150 F3000\nG1 X0"
    await site.arm(text, override=50.0)
    program = await site.start(text)
    await site.cell.until(lambda: site.extent()[1] > 60.0)
    service = site.cell.service
    service.abort(program.program)
    await site.cell.ended(program)
    rest = await service.continue_program(ANNA, program.program, confirmed=Confirmation(way=True))
    service.set_override(1.2, rest.program)
    assert rest.envelope == program.envelope is not None
    assert rest.override == 0.5
    # and so does what goes on with that one
    await site.cell.until(lambda: rest.state == "running")
    service.abort(rest.program)
    await site.cell.ended(rest)
    last = await service.continue_program(ANNA, program.program, confirmed=Confirmation(way=True))
    assert last.envelope == program.envelope
    await site.cell.ended(last)
    assert last.state == "finished", last.fault
    assert site.extent()[1] <= 150.1


async def test_an_armed_run_waits_for_its_client_as_long_as_it_was_asked_to(site: Site) -> None:
    await site.arm()
    reply = await site.arming.run_armed(BOT, wire.RunArmedRequest(text=TEXT, grace_s=30.0))
    assert site.cell.service.program(reply.program).grace_s == 30.0


async def test_a_program_that_is_put_in_front_moves_nothing_that_was_approved(site: Site) -> None:
    await site.arm()
    ahead = await site.cell.service.open(ANNA, ProgramOptions(axes=[0]))
    with pytest.raises(ServiceError, match="MC572: "):
        await site.start()
    site.cell.service.abort(ahead.program)
    await site.cell.ended(ahead)
    assert (await site.run()).state == "finished"


async def test_another_program_beside_it_does_not_move_its_axes_or_its_work_zero(site: Site) -> None:
    text = "G1 X100 F3000\nG1 X0"
    await site.arm(text)
    program = await site.start(text)
    other = await site.cell.run("G10 L2 P1 X300 Y20", "G0 Y30", axes=[1])
    assert other.state == "finished"
    await site.cell.ended(program)
    assert program.state == "finished", program.fault
    assert site.extent()[1] <= 100.1


@pytest.mark.parametrize(
    ("text", "worse"),
    [
        ("G1 X50 F6000\nG1 X0", "G1 X150 F6000\nG1 X0"),
        ("G0 X50\nG0 X0", "G0 X150\nG0 X0"),
        ("G91\nG1 X50 F6000\nG1 X-50", "G91\nG1 X150 F6000\nG1 X-50"),
    ],
    ids=["feed", "rapid", "incremental"],
)
async def test_a_planner_that_plans_something_else_is_stopped_by_the_executor(
    site: Site, monkeypatch: pytest.MonkeyPatch, text: str, worse: str
) -> None:
    await site.arm(text)
    lines = worse.split("\n")
    submit = site.cell.service.lines.submit

    def exchanged(client: str, program: str, first: int, _lines: object) -> object:
        return submit(client, program, first, lines)

    monkeypatch.setattr(site.cell.service.lines, "submit", exchanged)
    program = await site.run(text)
    assert program.fault is not None
    assert (program.state, program.fault.code, program.fault.axis) == ("faulted", "MC460", 0)
    assert site.extent()[1] <= 50.1


async def test_what_g1030_and_g1040_would_do_is_bounded_or_refused(site: Site) -> None:
    turning = await site.ask("G1030 [3]60\nG1 X5 F6000")
    assert (turning.extents[-1].turns, turning.extents[-1].speed) == (True, pytest.approx(360.0, rel=1e-3))
    assert "leaves A turning or pushing" in turning.effects
    for text in ("G1040 [3]0.1", "G1030 X60"):
        with pytest.raises(ServiceError, match="MC577: "):
            await site.ask(text)


async def test_a_run_is_not_asked_for_while_its_axes_still_move(site: Site) -> None:
    await site.by_hand("G1030 [3]60")
    with pytest.raises(ServiceError) as refused:
        await site.ask("G1 [3]90 F6000")
    assert refused.value.code == "MC572"
    assert refused.value.message.startswith("A ")


def test_every_field_of_the_start_counts_in_the_digest_and_in_what_has_changed() -> None:
    """A piece of state that is added to the start and forgotten in the comparison fails here."""
    from mcserver.gcode.profiles.frame import Frame
    from mcserver.gcode.semantics.modal import ModalState
    from mcserver.gcode.switches import Switches
    from mcserver.motion.canonical import MeshUse
    from mcserver.planning.start_state import changes_between
    from mcserver.service.approval_basis import ApprovalBasis

    machine = parse_machine(MILL)
    start, basis = StartState.of(machine), ApprovalBasis(machine)
    other: dict[str, Any] = {
        "positions": {**start.positions, 0: 0.1},
        "energized": frozenset({0}),
        "unsettled": frozenset({0}),
        "homed": frozenset({1, 2, 3}),
        "frame": Frame(systems={1: {0: 0.3}}),
        "modal": ModalState(inch=True),
        "inputs": (0.0, 0.0, 0.0),
        "outputs": (1.0,),
        "tool": 3,
        "mesh": frozenset({MeshUse.ON, MeshUse.MET}),
    }
    # what others changed at pauses, and the machine file of then, is the past of a program that goes on: a
    # run that is asked for has none; switches are asked for with the run, and it starts with these
    recorded = {"pauses", "machine_file", "cutters"}
    assert {*other, *recorded, "switches"} == set(StartState.__struct_fields__)
    skipping = msgspec.structs.replace(start, switches=Switches(block_delete=True))
    assert basis.digest(TEXT, (0,), skipping) != basis.digest(TEXT, (0,), start)
    for field, value in other.items():
        now = msgspec.structs.replace(start, **{field: value})
        tolerance = dict.fromkeys(range(4), 1e-4)
        axes = (0, 1, 2, 3)
        found = changes_between(machine, start, now, axes=axes, inputs=frozenset({0}), tolerance=tolerance)
        assert len(found) == 1, field
        assert basis.digest(TEXT, axes, now) != basis.digest(TEXT, axes, start), field
    assert basis.digest(TEXT, (0,), start) != basis.digest(TEXT, (0, 1), start)
    assert basis.digest(TEXT + " ", (0,), start) != basis.digest(TEXT, (0,), start)
    faster = parse_machine(MILL.replace("max_velocity = 500.0", "max_velocity = 501.0"))
    assert ApprovalBasis(faster).digest(TEXT, (0,), start) != basis.digest(TEXT, (0,), start)


# ------------------------------------------------------------------ an envelope for a while


async def approve(site: Site, override: float = 100.0) -> str:
    """Arm a run, and whatever stays inside of it for a while."""
    run = await site.ask(TEXT)
    request = wire.ArmRequest(sha256=run.sha256, override=override, number=run.number, standing_s=3600.0)
    return site.arming.arm(ANNA, request).sha256


def approvals(site: Site) -> list[wire.RunRequestStatus]:
    return site.arming.run_approvals(ANNA, wire.RunApprovalsRequest()).requests


async def test_what_stays_inside_of_an_approved_envelope_runs_without_another_look(site: Site) -> None:
    approved = await approve(site, override=50.0)
    assert (await site.run()).state == "finished"
    # another text, the same again, and from elsewhere
    for text in ("G1 X30 F3000", "G1 X10 F6000\nG1 X20", TEXT, TEXT):
        run = await site.ask(text)
        assert (run.state, run.operator, run.approval, run.beyond) == ("armed", ANNA, approved, [])
        program = await site.run(text)
        assert (program.state, program.override) == ("finished", 0.5)
    (left,) = approvals(site)
    assert (left.sha256, left.client) == (approved, BOT)
    assert 0.0 < left.remaining_s <= 3600.0
    assert site.extent() == pytest.approx((0.0, 50.0), abs=1e-3)


@pytest.mark.parametrize(
    ("text", "beyond"),
    [
        ("G1 X50.2 F6000\nG1 X0", "X goes to 50.200 mm"),
        ("G1 X-0.2 F6000\nG1 X0", "X goes to -0.200 mm"),
        ("G1 X50 F6100\nG1 X0", "X moves at 101"),
        ("G0 X50", "X moves at"),
        ("G1 X10 Y1 F6000", "it may move Y"),
        ("G1 X50 F6000\nG1 X0\nG4 P1", "it lasts"),
        ("M64 P0\nG1 X50 F6000\nM65 P0", 'it sets the output "clamp"'),
        (f"{SHIFT}\nG1 X-290 F6000", "it moves G54 X"),
        ("G2 X0.01 Y0 I5 J0 F600", "its simulation warns of MC139, line 1"),
    ],
)
async def test_what_leaves_an_approved_envelope_waits_for_the_person(
    site: Site, text: str, beyond: str
) -> None:
    await approve(site)
    assert (await site.run()).state == "finished"
    run = await site.ask(text)
    assert (run.state, run.approval) == ("waiting", "")
    assert any(beyond in each for each in run.beyond), run.beyond
    with pytest.raises(ServiceError, match="MC571"):
        await site.start(text)


async def test_an_approval_for_a_while_is_in_machine_coordinates(site: Site) -> None:
    await approve(site)
    assert (await site.run()).state == "finished"
    await site.by_hand("G10 L2 P1 X300")
    assert (await site.ask(TEXT)).state == "waiting"
    assert (await site.ask("G1 X-290 F3000")).state == "armed"


async def test_an_approval_for_a_while_is_of_one_client(site: Site) -> None:
    await approve(site)
    assert (await site.run()).state == "finished"
    assert (await site.ask("G1 X30 F3000", client="bot.agent-2")).state == "waiting"
    assert (await site.ask("G1 X31 F3000", client="eve.agent-1")).state == "waiting"


@pytest.mark.parametrize("end", ["estop", "reject", "withdraw", "gone"])
async def test_an_approval_for_a_while_ends_with(site: Site, end: str) -> None:
    sha = await approve(site)
    inside = "G1 X30 F3000"
    assert (await site.ask(inside)).state == "armed"
    if end == "estop":
        site.cell.service.latch.emergency_stop(ANNA, "")
        site.cell.service.reset(None)
    elif end == "reject":
        site.arming.reject(ANNA, wire.RejectRequest(sha256=sha[:12], reason="enough"))
    elif end == "withdraw":
        site.arming.withdraw(BOT, wire.WithdrawRequest(sha256=sha))
    else:
        site.arming._client_gone(BOT)
    assert approvals(site) == []
    with pytest.raises(ServiceError, match="MC571"):
        await site.start(inside)
    assert (await site.ask(inside)).state == "waiting"


async def test_an_approval_for_a_while_is_not_given_to_oneself(site: Site) -> None:
    run = await site.ask()
    with pytest.raises(ServiceError, match="MC575"):
        site.arming.arm("bot.mcctl-1", wire.ArmRequest(sha256=run.sha256, standing_s=60.0))
    assert approvals(site) == []


async def test_a_run_inside_of_an_approval_does_not_start_from_another_state(site: Site) -> None:
    await approve(site)
    assert (await site.run()).state == "finished"
    assert (await site.ask("G1 X30 F3000")).state == "armed"
    await site.by_hand("G1 X200 F6000")
    assert "X" in await site.refusal("G1 X30 F3000")


async def test_a_spindle_that_m5_has_stopped_keeps_no_run_from_being_asked_for(tmp_path: Path) -> None:
    spindle = MILL.replace('profile = "cnc"', 'profile = "cnc"\nspindle_axis = 3')
    site = Site(parse_machine(spindle), tmp_path)
    text = "S600 M3\nG1 X10 F6000\nM5"
    for _ in range(2):
        run = await site.arm(text)
        assert not [each for each in run.effects if "turning" in each]
        program = await site.run(text)
        assert program.state == "finished", program.fault
    # and one that turns does
    await site.by_hand("S600 M3")
    with pytest.raises(ServiceError, match="MC572: "):
        await site.ask(text)
    await site.cell.stop()
