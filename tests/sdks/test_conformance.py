"""One behaviour of all SDKs: their conformance programs against a real server.

Through the gateway a client keeps its programs over a connection that is away for 5 s. With Zenoh the
server sees the client's link go and ends its programs as it was asked to: there the SDK has to say how far
they came.
"""

from __future__ import annotations

import json
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from mcclient import sync

from tests.e2e.servers import ServerProcess
from tests.gateway.conftest import GatewayProcess
from tests.sdks.conftest import AXES, environment, program_file, to_zero
from tests.sdks.languages import SDKS, Sdk, ToolMissing
from tests.sdks.link import CuttableLink

Tokens = tuple[Path, dict[str, str]]
# below the limit of pytest, which would leave the process behind
LIMIT_S = 60.0
LINES = 20_000
HEAD = ["G1010", "G91 G64 F6000"]
# each line moves by this: where the axis ends says how often each one has run
STEP_MM = 0.001
CUT_S = 5.0
# a language's first test builds its SDK, and what that depends on
pytestmark = pytest.mark.timeout(1000)


class Conformance:
    """An SDK's conformance program, at the address that it needs."""

    def __init__(self, sdk: Sdk, address: str, token: str) -> None:
        self.through = sdk.through
        self.address = address
        self._command = sdk.command
        self._token = token
        self._started: list[subprocess.Popen[str]] = []

    def start(
        self, *task: str, address: str | None = None, token: str | None = None
    ) -> subprocess.Popen[str]:
        credentials = [address or self.address, self._token if token is None else token]
        process = subprocess.Popen(
            [*self._command, *credentials, *task],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=environment(),
        )
        self._started.append(process)
        return process

    def end(self) -> None:
        """Kill what has been started and is there still."""
        for process in self._started:
            if process.poll() is None:
                end(process)

    def run(self, *task: str, token: str | None = None) -> tuple[int, list[Any]]:
        return outcome(self.start(*task, token=token))


def outcome(process: subprocess.Popen[str]) -> tuple[int, list[Any]]:
    """The exit code and what it said, once it has ended."""
    try:
        said, complaints = process.communicate(timeout=LIMIT_S)
    except subprocess.TimeoutExpired:
        pytest.fail(f"it does not end after {LIMIT_S:g} s; it said {end(process)}")
    assert not complaints, complaints
    return process.returncode, [json.loads(line) for line in said.splitlines()]


def end(process: subprocess.Popen[str]) -> tuple[str, str]:
    """Kill it, where it is there still; what it said."""
    process.kill()
    return process.communicate()


@pytest.fixture
def program(
    sdk: Sdk, server: ServerProcess, gateway: GatewayProcess, tokens: Tokens
) -> Iterator[Conformance]:
    made = Conformance(
        sdk, gateway.ws if sdk.through == "gateway" else server.endpoint, tokens[1]["operator"]
    )
    yield made
    # a test that failed in the middle leaves nothing behind that works on
    made.end()


def small_steps(folder: Path, lines: int = LINES, step_mm: float = STEP_MM) -> Path:
    return program_file(folder, HEAD + [f"G01 X{step_mm}"] * (lines - len(HEAD)))


# of which one has a core for itself
TRIES = 5


def reach(machine: sync.Machine, process: subprocess.Popen[str], share: float) -> str:
    """Wait until a share of the lines has been accepted; the program's id."""
    assert process.stdout is not None
    opened = json.loads(process.stdout.readline())["program"]
    while machine.programs(opened)[0].accepted < share * LINES:
        assert process.poll() is None, f"it has ended before: {end(process)}"
    return str(opened)


def test_20_000_lines_run_exactly_once(program: Conformance, machine: sync.Machine, tmp_path: Path) -> None:
    code, said = program.run("stream", str(small_steps(tmp_path)))
    assert (code, said[-1]) == (0, {"state": "finished", "accepted": LINES, "done": LINES})
    assert machine.status().axes.setpoint[0] == pytest.approx((LINES - len(HEAD)) * STEP_MM, abs=1e-6)


def test_a_stream_that_is_given_up_feeds_nothing_more_and_the_next_line_has_the_next_number(
    program: Conformance, machine: sync.Machine, tmp_path: Path
) -> None:
    code, said = program.run("cancel", str(small_steps(tmp_path, 1000)))
    assert code == 0, said
    ended = said[-1]
    assert ended["accepted"] == ended["done"] == ended["next"] <= ended["fed"] + 1
    assert ended["fed_later"] == 0
    assert machine.status().axes.setpoint[0] == pytest.approx((ended["done"] - len(HEAD)) * STEP_MM, abs=1e-6)


@pytest.mark.usefixtures("machine")
def test_a_faulty_line_is_named_with_its_column(program: Conformance, tmp_path: Path) -> None:
    file = program_file(tmp_path, ["G1010", "G01 X1 F6000", "G02 X100 Y0 R30"])
    code, said = program.run("stream", str(file))
    assert code == 1
    (found,) = said[-1]["diagnostics"]
    assert (found["code"], found["line"], found["column"]) == ("MC104", 3, 13)


def test_samples_of_64_axes_come_without_a_gap(program: Conformance) -> None:
    # telemetry is for the latest: on a computer with no core left for a reader, rows may be dropped
    gaps = []
    for _ in range(TRIES):
        code, said = program.run("watch", "2000")
        assert code == 0
        assert said[-1]["rows"] >= 2000
        assert said[-1]["axes"] == AXES
        gaps.append(said[-1]["gaps"])
        if gaps[-1] == 0:
            break
    assert gaps[-1] == 0, gaps


def test_a_jog_moves_as_long_as_it_is_held(program: Conformance, machine: sync.Machine) -> None:
    before = machine.status().axes.setpoint[1]
    code, said = program.run("jog", "1", "20", "800")
    assert code == 0, said
    while machine.programs(ended=False):
        pass
    assert machine.status().axes.setpoint[1] > before + 1.0
    assert max(map(abs, machine.status().axes.velocity)) < 0.01


def test_an_emergency_stop_is_confirmed(program: Conformance, machine: sync.Machine) -> None:
    assert program.run("estop") == (0, [{"state": "estop"}])
    assert machine.status().state == "estop"
    # a late copy of it, on another way, stops nothing anew
    machine.reset()
    to_zero(machine)


@pytest.mark.parametrize("token", ["wrong", ""])
def test_a_wrong_token_is_said_with_a_remedy(program: Conformance, token: str) -> None:
    if program.through == "zenoh":
        pytest.skip("there is no token; access rules are tested in tests/security")
    code, said = program.run("estop", token=token)
    assert (code, said[-1]["code"]) == (1, "MC530")
    assert said[-1]["hint"]


def test_a_link_that_is_cut_while_lines_stream_loses_and_repeats_nothing(
    program: Conformance, machine: sync.Machine, tmp_path: Path
) -> None:
    link = CuttableLink(program.address)
    # so many with Zenoh that they are not through before the link is away
    lines = LINES if program.through == "gateway" else 4 * LINES
    process = program.start("stream", str(small_steps(tmp_path, lines)), address=link.address)
    opened = reach(machine, process, 0.1)
    link.cut()
    if program.through == "gateway":
        while machine.programs(opened)[0].accepted < 0.4 * LINES:
            assert process.poll() is None, f"it has ended before: {end(process)}"
    link.cut(CUT_S)
    code, said = outcome(process)
    link.close()
    known = machine.programs(opened)[0]
    # at every door a program waits for its client for its grace, which is longer than the cut
    assert (code, said[-1]) == (0, {"state": "finished", "accepted": lines, "done": lines})
    assert machine.status().axes.setpoint[0] == pytest.approx(
        (known.accepted - len(HEAD)) * STEP_MM, abs=1e-6
    )


def test_a_server_that_is_killed_interrupts_the_program_and_one_call_goes_on(
    program: Conformance, server: ServerProcess, tmp_path: Path
) -> None:
    # they move for two seconds at least: the server is killed meanwhile
    lines = LINES if program.through == "gateway" else 4 * LINES
    step_mm = 0.01
    file = small_steps(tmp_path, lines, step_mm)
    with sync.Machine.connect("cell", server.endpoint) as machine:
        to_zero(machine)
        process = program.start("stream", str(file))
        interrupted = reach(machine, process, 0.3)
        while machine.programs(interrupted)[0].done < len(HEAD):
            assert process.poll() is None, f"it has ended before: {end(process)}"
    server.end(signal.SIGKILL)
    server.start()
    code, said = outcome(process)
    assert (code, said[-1]["code"]) == (1, "MC534")
    with sync.Machine.connect("cell", server.endpoint) as machine:
        known = machine.programs(interrupted)[0]
        assert (known.state, known.done) == ("interrupted", said[-1]["done"])
        code, said = program.run("stream", str(file), interrupted)
        assert said[0] == {"continuation": {"line": known.done + 1, "done": known.done, "axes": AXES}}
        assert (code, said[-1]) == (0, {"state": "finished", "accepted": lines, "done": lines})
        # the way leads to where the program had come
        assert machine.status().axes.setpoint[0] == pytest.approx((lines - len(HEAD)) * step_mm, abs=1e-6)


def test_in_every_sdk_a_program_whose_text_the_server_has_goes_on_to_its_end_by_itself(
    server: ServerProcess, gateway: GatewayProcess, tokens: Tokens, tmp_path: Path
) -> None:
    lines = [*HEAD, "G01 X1"]
    file = program_file(tmp_path, lines)
    with sync.Machine.connect("cell", server.endpoint) as machine:
        to_zero(machine)
        # one of them is held, the others wait behind it
        waiting = [machine.program("whole", axes=[0], hold=True) for _ in SDKS]
        for each in waiting:
            each.send_lines(lines)
            each.close()
        server.end(signal.SIGKILL)
    server.start()
    for build, each in zip(SDKS.values(), waiting, strict=True):
        try:
            sdk = build()
        except ToolMissing:
            continue
        address = gateway.ws if sdk.through == "gateway" else server.endpoint
        code, said = Conformance(sdk, address, tokens[1]["operator"]).run("stream", str(file), each.id)
        ended = {"state": "finished", "accepted": len(lines), "done": len(lines)}
        assert (code, said[-1]) == (0, ended), (sdk, said)
