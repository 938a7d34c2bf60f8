"""Parameters that stay from program to program: at pauses, and when one goes on at a line (D-81)."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from mcserver.gcode.computing.parameters import ComputedState
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.planning.start_state import StartState
from mcserver.planning.state_before import state_before
from mcserver.service.approach import Confirmation
from mcserver.service.work_offsets import WorkOffsets, offsets_file
from tests.machine_text import axes_text
from tests.service.test_pauses import Shop


def mill(keys: str = "persistent = [[100, 120]]") -> Machine:
    travel = "max_jerk = 50000.0\nmin_position = -200.0\nmax_position = 500.0\nmax_following_error = 5.0"
    axes = axes_text(range(3), keys=travel)
    return parse_machine(f'[machine]\nname = "mill"\n{axes}[dialect]\nprofile = "cnc"\n{keys}\n')


def stored(folder: Path) -> dict[int, float]:
    return WorkOffsets(offsets_file(folder / "journal.db")).parameters


async def test_what_others_set_at_a_pause_stays(tmp_path: Path) -> None:
    shop = Shop(mill(), tmp_path)
    program = await shop.at_pause(["#101 = 3", "#103 = 1", "M0", "G1 X#101 F3000", "#102 = 4"])
    assert (await shop.by_hand("#100 = 7", "#101 = 9", "G10 L2 P1 X1")).state == "finished"
    assert (await shop.resumed(program)).state == "finished"
    # zero counts from the pause on, a parameter for later programs
    assert shop.at()[0] == pytest.approx(1.0 + 3.0)
    await shop.stop()
    assert stored(tmp_path) == {100: 7.0, 101: 9.0, 102: 4.0, 103: 1.0}


@pytest.mark.parametrize(
    ("keys", "clearing"),
    [("persistent = [[100, 120]]", "#100 = 0"), ('macros = "fanuc"\npersistent = [[100, 120]]', "#100 = #0")],
)
async def test_a_program_clears_what_it_has_set(tmp_path: Path, keys: str, clearing: str) -> None:
    shop = Shop(mill(keys), tmp_path)
    await shop.run("#100 = 5", "G1 X1 F3000", clearing)
    await shop.stop()
    assert stored(tmp_path) == {}


async def test_one_that_the_machine_file_no_longer_names_begins_anew(tmp_path: Path) -> None:
    shop = Shop(mill(), tmp_path)
    await shop.run("#100 = 5", "#120 = 4")
    await shop.stop()
    shop = Shop(mill("persistent = [[120, 130]]"), tmp_path, "second")
    await shop.run("G1 X[#100 + #120] F3000")
    assert shop.at()[0] == pytest.approx(4.0)
    await shop.stop()


async def test_a_continued_program_has_its_parameters_and_stores_only_those_it_sets(tmp_path: Path) -> None:
    shop = Shop(mill(), tmp_path)
    await shop.run("#100 = 5")
    lines = ["o<up> sub", "#101 = [#101 + #1]", "o<up> endsub", "#100 = [#100 + 1]", "#50 = 7", "#<a> = 3"]
    lines += ["G1 X10 F3000", "M0", "G1 X#50 Y#<a>", "o<up> call [#100]", "G1 Z#101"]
    program = await shop.at_pause(lines)
    await shop.until(lambda: program.ack().done >= 7)
    shop.kill()
    shop = Shop(mill(), tmp_path, "second")
    await shop.run("#100 = 50", "#110 = 1")
    again = await shop.service.continue_program("page", program.program, confirmed=Confirmation(way=True))
    await shop.paused(again)
    # its way back to X10 has led it by lines of another dialect
    assert again.approach
    assert (await shop.resumed(again)).state == "finished"
    assert shop.at() == pytest.approx((7.0, 3.0, 6.0))
    await shop.stop()
    assert stored(tmp_path) == {100: 50.0, 101: 6.0, 110: 1.0}


async def test_a_variable_without_value_has_none_where_a_program_goes_on(tmp_path: Path) -> None:
    shop = Shop(mill('macros = "fanuc"'), tmp_path)
    await shop.run("#500 = 5", "#501 = 8")
    lines = ["#500 = #0", "#100 = #0", "G1 X10 F3000", "M0", "G1 X#500 Y#100 Z#501"]
    kept = state_before(lines, 4, mill('macros = "fanuc"'), StartState.of(mill())).modal.computed
    # on the way to the planner's process
    assert msgspec.msgpack.decode(msgspec.msgpack.encode(kept), type=ComputedState) == kept
    program = await shop.at_pause(lines)
    await shop.until(lambda: program.ack().done >= 3)
    shop.kill()
    shop = Shop(mill('macros = "fanuc"'), tmp_path, "second")
    again = await shop.service.continue_program("page", program.program, confirmed=Confirmation(way=True))
    await shop.paused(again)
    assert (await shop.resumed(again)).state == "finished"
    assert shop.at() == pytest.approx((10.0, 0.0, 8.0))
    await shop.stop()
    assert stored(tmp_path) == {501: 8.0}


async def test_what_a_block_sets_ahead_of_its_faulty_line_stays(tmp_path: Path) -> None:
    shop = Shop(mill(), tmp_path)
    lines = ["#100 = 1", "o1 if [#100 EQ 1]", "#101 = 7", "#102 = [1 / 0]", "#103 = 1", "o1 endif"]
    program = await shop.ended(await shop.begin_part(lines))
    assert (program.state, program.rejected) == ("rejected", 4)
    await shop.stop()
    assert stored(tmp_path) == {100: 1.0, 101: 7.0}
