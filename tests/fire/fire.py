"""One program under one fault on a bad link, in processes of its own."""

from __future__ import annotations

import contextlib
import enum
import json
import os
import random
import signal
import sqlite3
import subprocess
import sys
import time
from pathlib import Path

import msgspec

from mcserver.executor.process import SERVER_TIMEOUT_S
from tests.e2e.servers import ROOT, ServerProcess, environment, wait_for_end
from tests.fire.agreement import disagreement, read_journal
from tests.fire.disk import StallingDisk
from tests.fire.link import SERVER_ADDRESS, BadLink, Weather

PORT = 17447
CLIENT_LIMIT_S = 120.0
REST_LIMIT_S = 60.0
# a server that was stopped for less goes on; one whose executor has ended ends within so much
SURVIVED_S = 0.75 * SERVER_TIMEOUT_S
# for a server whose executor has ended, to end too: beside much other work it takes its time
ENDS_S = 60.0


class Fault(enum.Enum):
    """What happens while the program runs."""

    NOTHING = "a quiet link"
    LOSSY = "loss 2 %, doubled 1 %, late and out of order by up to 30 ms"
    STALLED = "the link stalls for 0.2 to 4 s, and comes back"
    CUT = "the link is cut for 0.2 to 4 s, and comes back"
    CLIENT_STOPPED = "client stopped for 0.2 to 4 s (SIGSTOP)"
    CLIENT_KILLED = "client killed"
    SERVER_STOPPED = "server stopped for 0.2 to 4 s, started again where that ends it"
    SERVER_KILLED = "server killed, and started again"
    PLANNER_STOPPED = "planner stopped for 0.2 to 4 s"
    PLANNER_KILLED = "planner killed"
    DISK_STALLED = "the journal's disk stalls for 0.2 to 4 s"
    DISK_STALLED_SERVER_KILLED = "it stalls, and the server is killed in that time and started again"
    EXECUTOR_STOPPED = "executor stopped for 0.05 to 1 s"
    HELD = "held for 0.2 to 4 s, and resumed"
    OVERRIDDEN = "override 20, 50 or 150 % for 0.2 to 4 s"
    ABORTED = "aborted"
    STOPPED = "emergency stop"


ORDERS = (Fault.HELD, Fault.OVERRIDDEN, Fault.ABORTED, Fault.STOPPED)
FINISHING = (Fault.NOTHING, Fault.HELD, Fault.OVERRIDDEN)


class Outcome(msgspec.Struct, frozen=True):
    """How a program ended; ``wrong`` is empty where all agrees."""

    wrong: str
    state: str
    accepted: int
    done: int
    recovery_s: float


def burn(
    link: BadLink, server: ServerProcess, fault: Fault, chance: random.Random, disk: StallingDisk
) -> Outcome:
    """Run one program under a fault; the server runs before and after."""
    stalls = fault in (Fault.DISK_STALLED, Fault.DISK_STALLED_SERVER_KILLED)
    # long enough to be met by the stall, or by the order
    lines = chance.randrange(1000, 3000) if stalls or fault in ORDERS else chance.randrange(20, 300)
    before = _at_rest(link, server)
    earlier = _last_program(server.journal)
    command = [
        *link.inside(1),
        sys.executable,
        "-m",
        "tests.fire.client",
        server.endpoint,
        server.name,
        str(lines),
    ]
    client = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment(), cwd=ROOT)
    time.sleep(chance.uniform(0.3, 2.0))
    heard: dict[str, int] = {}
    if stalls:
        _wait_until_it_moves(server.journal, earlier, client)
        killed_server = _stall(chance, link, server, disk, heard, kill=fault is not Fault.DISK_STALLED)
    else:
        killed_server = _disturb(fault, chance, link, server, client)
    gone = time.monotonic()
    if killed_server:
        server.wait()
        server.start()
    written, _ = client.communicate(timeout=CLIENT_LIMIT_S)
    link.weather = Weather()
    position = _at_rest(link, server)
    recovery = time.monotonic() - gone
    said = json.loads(written) if written else {}
    program = str(said.get("program") or "") or _last_program(server.journal)
    if program == earlier:
        # the client was killed before it had one
        return Outcome("", "never opened", 0, 0, recovery)
    if not said:
        # it was killed: nothing of what it was answered is known
        said = {"accepted": 0, "done": 0, "state": "", "program": program}
    kept = read_journal(server.journal, program)
    # simulated drives begin anew with the server
    moved = None if killed_server else position - before
    wrong = disagreement(said, lines, kept, moved)
    if heard.get(program, 0) > kept.done:
        wrong = wrong or f"its status or events said {heard[program]} lines done, the journal has {kept.done}"
    if fault in FINISHING and said["state"] != "finished":
        wrong = wrong or f"on a quiet link it ended {said}"
    return Outcome(wrong, str(kept.state), kept.accepted, kept.done, recovery)


def _disturb(
    fault: Fault, chance: random.Random, link: BadLink, server: ServerProcess, client: subprocess.Popen[str]
) -> bool:
    """Let the fault happen; whether the server has to be started again."""
    moment = chance.uniform(0.2, 4.0)
    match fault:
        case Fault.LOSSY:
            link.weather = Weather(loss=0.02, double=0.01, delay_s=0.03)
        case Fault.STALLED:
            link.weather = Weather(stalled=True)
            time.sleep(moment)
            link.weather = Weather()
        case Fault.CUT:
            link.weather = Weather(cut=True)
            time.sleep(moment)
            link.weather = Weather()
        case Fault.CLIENT_STOPPED:
            _pause(client.pid, moment)
        case Fault.CLIENT_KILLED:
            client.kill()
        case Fault.SERVER_STOPPED:
            _pause(server.pid, moment)
            # its executor stops all axes and ends without its beat, and the server with it (MC518)
            return moment > SURVIVED_S and wait_for_end(server.pid, ENDS_S)
        case Fault.SERVER_KILLED:
            os.kill(server.pid, signal.SIGKILL)
            return True
        case Fault.PLANNER_STOPPED:
            for pid in server.planners():
                _pause(pid, moment)
        case Fault.PLANNER_KILLED:
            for pid in server.planners():
                os.kill(pid, signal.SIGKILL)
        case Fault.EXECUTOR_STOPPED:
            for pid in server.executors():
                _pause(pid, chance.uniform(0.05, 1.0))
        case Fault.HELD:
            _ask(link, server, "hold")
            time.sleep(moment)
            _ask(link, server, "resume")
        case Fault.OVERRIDDEN:
            _ask(link, server, f"override={chance.choice((20, 50, 150))}")
            time.sleep(moment)
            _ask(link, server, "override=100")
        case Fault.ABORTED:
            _ask(link, server, "abort")
        case Fault.STOPPED:
            _ask(link, server, "estop")
        case Fault.NOTHING:
            pass
    return False


def _wait_until_it_moves(journal: Path, earlier: str, client: subprocess.Popen[str]) -> None:
    """Wait until the journal has lines of a new program that have ended, or its client has."""
    while client.poll() is None:
        program = _last_program(journal)
        if program != earlier and read_journal(journal, program).done > 0:
            return
        time.sleep(0.05)


def _stall(
    chance: random.Random,
    link: BadLink,
    server: ServerProcess,
    disk: StallingDisk,
    heard: dict[str, int],
    *,
    kill: bool,
) -> bool:
    """Let the journal's disk stall, and note what status and events say of programs; whether the server was
    killed."""
    disk.stall()
    try:
        time.sleep(chance.uniform(0.2, 4.0))
        state = _ask(link, server)
        if state is not None:
            done: dict[str, int] = state["done"]  # type: ignore[assignment]
            ended: dict[str, int] = state["ended"]  # type: ignore[assignment]
            heard.update({each: max(done[each], ended.get(each, 0)) for each in done})
        if kill:
            os.kill(server.pid, signal.SIGKILL)
    finally:
        disk.go_on()
    return kill


def _pause(pid: int, seconds: float) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, signal.SIGSTOP)
        time.sleep(seconds)
        os.kill(pid, signal.SIGCONT)


_ASK = """
import json, sys, time
import msgspec, zenoh
from tests.bench.server import client_config
with zenoh.open(client_config(sys.argv[1])) as session:
    number = time.time_ns() % 2**62
    for call in sys.argv[3:]:
        method, _, percent = call.partition("=")
        number += 1
        payload = msgspec.msgpack.encode({"request": number} | ({"percent": int(percent)} if percent else {}))
        key = f"mc/@v1/{sys.argv[2]}/@rpc/fire-watch/{method}"
        for reply in session.get(key, payload=payload, timeout=5.0):
            if reply.ok is not None:
                last = msgspec.msgpack.decode(reply.ok.payload.to_bytes())
    key = f"mc/@v1/{sys.argv[2]}/@rpc/fire-watch/events"
    ended, since = {}, 0
    for limit in (1, 1000):
        number += 1
        payload = msgspec.msgpack.encode({"request": number, "since": since, "limit": limit})
        for reply in session.get(key, payload=payload, timeout=5.0):
            if reply.ok is None:
                continue
            told = msgspec.msgpack.decode(reply.ok.payload.to_bytes())
            since = max(0, told["newest"] - 990)
            for event in told["events"]:
                lines = [each["line"] for each in event.get("lines", [])]
                if event["kind"] in ("lines.ended", "program.ended"):
                    lines += [event.get("line", 0), ended.get(event["program"], 0)]
                    ended[event["program"]] = max(lines)
print(json.dumps({"axes": last["axes"]["position"], "state": last["state"], "ended": ended,
                  "done": {p["program"]: p["done"] for p in last["programs"]},
                  "open": [p["program"] for p in last["programs"] if p.get("ended_at") is None]}))
"""


def _ask(link: BadLink, server: ServerProcess, *calls: str) -> dict[str, object] | None:
    """The state of the machine, behind other calls; None: it does not answer."""
    command = [*link.inside(1), sys.executable, "-c", _ASK, server.endpoint, server.name, *calls, "status"]
    done = subprocess.run(command, capture_output=True, text=True, env=environment(), cwd=ROOT, check=False)
    found: dict[str, object] | None = json.loads(done.stdout) if done.returncode == 0 else None
    return found


def _at_rest(link: BadLink, server: ServerProcess) -> float:
    """Wait until nothing runs, and clear what is latched; where the axis is then [mm]."""
    until = time.monotonic() + REST_LIMIT_S
    last: object = None
    while time.monotonic() < until:
        state = _ask(link, server)
        if state is not None and not state["open"]:
            if state["state"] != "ready":
                _ask(link, server, "reset")
            elif state["axes"] == last:
                return float(state["axes"][0])  # type: ignore[index]
            last = state["axes"]
        time.sleep(0.1)
    raise TimeoutError(f"the machine does not come to rest: {_ask(link, server)}")


def _last_program(journal: Path) -> str:
    with contextlib.closing(
        sqlite3.connect(f"{journal.absolute().as_uri()}?mode=ro", uri=True)
    ) as connection:
        found = connection.execute("SELECT program FROM programs ORDER BY id DESC LIMIT 1").fetchone()
    return str(found[0]) if found else ""


def make_server(link: BadLink, folder: Path, disk: StallingDisk) -> ServerProcess:
    """A server at its end of the link; not started yet."""
    endpoint = f"tcp/{SERVER_ADDRESS}:{PORT}"
    return ServerProcess(folder, "cartesian", "fire", inside=[*link.inside(0), *disk.under], listen=endpoint)
