"""One behaviour of all SDKs: their conformance programs against a real server through the gateway."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest
from mcclient import sync

from tests.gateway.conftest import GatewayProcess
from tests.sdks.conftest import environment, program_file
from tests.sdks.link import CuttableLink

Tokens = tuple[Path, dict[str, str]]
LIMIT_S = 110.0
LINES = 20_000
# each line moves by this: where the axis ends says how often each one has run
STEP_MM = 0.001


@pytest.fixture(params=["typescript"])
def sdk(request: pytest.FixtureRequest) -> list[str]:
    """The command of one SDK's conformance program."""
    command: list[str] = request.getfixturevalue(request.param)
    return command


def run(sdk: list[str], url: str, token: str, *task: str) -> tuple[int, list[Any]]:
    done = subprocess.run(
        [*sdk, url, token, *task],
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        env=environment(),
        check=False,
    )
    assert not done.stderr, done.stderr
    return done.returncode, [json.loads(line) for line in done.stdout.splitlines()]


def small_steps(folder: Path, count: int) -> Path:
    return program_file(folder, ["G1010", "G91 G64 F6000"] + [f"G01 X{STEP_MM}"] * (count - 2))


def test_20_000_lines_run_exactly_once(
    sdk: list[str], gateway: GatewayProcess, tokens: Tokens, machine: sync.Machine, tmp_path: Path
) -> None:
    file = small_steps(tmp_path, LINES)
    code, said = run(sdk, gateway.ws, tokens[1]["operator"], "stream", str(file))
    assert (code, said[-1]) == (0, {"state": "finished", "accepted": LINES, "done": LINES})
    assert machine.status().axes.setpoint[0] == pytest.approx((LINES - 2) * STEP_MM, abs=1e-6)


def test_a_link_that_is_cut_while_lines_stream_loses_and_repeats_nothing(
    sdk: list[str], gateway: GatewayProcess, tokens: Tokens, machine: sync.Machine, tmp_path: Path
) -> None:
    link = CuttableLink(gateway.ws)
    file = small_steps(tmp_path, LINES)
    command = [*sdk, link.url, tokens[1]["operator"], "stream", str(file)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment()) as process:
        assert process.stdout is not None
        opened = json.loads(process.stdout.readline())
        for share in (0.1, 0.3, 0.6):
            while machine.programs(opened["program"])[0].accepted < share * LINES:
                pass
            link.cut()
        ended = json.loads(process.stdout.readline())
    link.close()
    assert ended == {"state": "finished", "accepted": LINES, "done": LINES}
    assert machine.status().axes.setpoint[0] == pytest.approx((LINES - 2) * STEP_MM, abs=1e-6)


def test_a_faulty_line_is_named_with_its_column(
    sdk: list[str], gateway: GatewayProcess, tokens: Tokens, tmp_path: Path
) -> None:
    file = program_file(tmp_path, ["G1010", "G01 X1 F6000", "G02 X100 Y0 R30"])
    code, said = run(sdk, gateway.ws, tokens[1]["operator"], "stream", str(file))
    assert code == 1
    (found,) = said[-1]["diagnostics"]
    assert (found["code"], found["line"], found["column"]) == ("MC104", 3, 13)


def test_samples_of_every_cycle_come_without_a_gap(
    sdk: list[str], gateway: GatewayProcess, tokens: Tokens
) -> None:
    code, said = run(sdk, gateway.ws, tokens[1]["observer"], "watch", "2000")
    assert code == 0
    assert said[-1]["rows"] >= 2000
    assert said[-1]["gaps"] == 0


def test_a_jog_moves_as_long_as_it_is_held(
    sdk: list[str], gateway: GatewayProcess, tokens: Tokens, machine: sync.Machine
) -> None:
    before = machine.status().axes.setpoint[1]
    assert run(sdk, gateway.ws, tokens[1]["operator"], "jog", "1", "20", "800")[0] == 0
    while machine.programs(ended=False):
        pass
    assert machine.status().axes.setpoint[1] > before + 1.0
    assert max(map(abs, machine.status().axes.velocity)) < 0.01


def test_an_emergency_stop_is_confirmed(
    sdk: list[str], gateway: GatewayProcess, tokens: Tokens, machine: sync.Machine
) -> None:
    assert run(sdk, gateway.ws, tokens[1]["operator"], "estop") == (0, [{"state": "estop"}])
    assert machine.status().state == "estop"


@pytest.mark.parametrize("token", ["wrong", ""])
def test_a_wrong_token_is_said_with_a_remedy(sdk: list[str], gateway: GatewayProcess, token: str) -> None:
    code, said = run(sdk, gateway.ws, token, "estop")
    assert (code, said[-1]["code"]) == (1, "MC530")
    assert said[-1]["hint"]
