"""A server that keeps the key space minimally, over real Zenoh, and that can be made to fail.

It moves nothing: a line that is accepted has ended as soon as `FakeServer.runs_by_itself` or `run_lines` says
so.
"""

from __future__ import annotations

import functools
import itertools
import threading
import time
import zlib
from collections import Counter
from collections.abc import Callable
from typing import Any

import msgpack
import zenoh
from fake_methods import QUEUE_LINES, FakeMethods, FakeProgram, Refusal, shapes

from tests.zenoh_sessions import locator_of, opened

ENCODING = "application/msgpack"


class FakeServer(FakeMethods):
    """One machine on a port of its own.

    Attributes:
        executed: (program, line number, text) of each line in the order of its execution.
        lose: how many of what to lose: ``"reply:submit"``, ``"query:open"``, ``"put"``, ``"ack"``,
            ``"event"``.
        calls: how often each method was carried out; ``asked``: how often it was asked.
    """

    def __init__(self, name: str = "cell", *, axes: int = 3, runs_by_itself: bool = True) -> None:
        self.name = name
        self.runs_by_itself = runs_by_itself
        self.credit_limit = QUEUE_LINES
        self.executed: list[tuple[str, int, str]] = []
        self.lose: Counter[str] = Counter()
        self.calls: Counter[str] = Counter()
        self.asked: Counter[str] = Counter()
        self.programs: dict[str, FakeProgram] = {}
        self.requests: list[tuple[str, dict[str, Any]]] = []
        self.state = "ready"
        self.override = 100.0
        self.confirm_estop = True
        self.estops = 0
        self.check_diagnostics: list[dict[str, Any]] = []
        self.texts: list[bytes] = []
        self.events: list[dict[str, Any]] = []
        self.axis_count = axes
        self.unhomed: set[int] = set()
        self.endpoint = ""
        self.instance = ""
        self._answers: dict[tuple[str, int], tuple[bool, bytes]] = {}
        self._clients: set[str] = set()
        self._lock = threading.RLock()
        self._session: zenoh.Session | None = None
        self._declared: list[Any] = []
        self._ids = itertools.count(1)
        self._instances = itertools.count(1)
        self._seq = itertools.count(0)
        self._cycle = 0
        self._changed = threading.Condition(self._lock)

    # ------------------------------------------------------------ life

    def start(self) -> FakeServer:
        """Listens: on a free port the first time, then on the same one again."""
        self.instance = self.instance or f"67{zlib.crc32(self.name.encode()):08x}{next(self._instances):04x}"
        settings = {"timestamping/enabled": True, "adminspace/enabled": True, "id": self.instance}
        session = opened({"listen/endpoints": [self.endpoint or "tcp/127.0.0.1:0"], **settings})
        self._session = session
        self.endpoint = self.endpoint or locator_of(session)
        root = f"mc/@v1/{self.name}"
        here = zenoh.handlers.Callback
        self._events = zenoh.ext.declare_advanced_publisher(
            session,
            f"{root}/event",
            cache=zenoh.ext.CacheConfig(1000),
            sample_miss_detection=zenoh.ext.MissDetectionConfig(heartbeat=0.5, sporadic_heartbeat=None),
            publisher_detection=True,
        )
        live = session.liveliness()
        self._declared = [
            session.declare_queryable(f"{root}/@rpc/*/*", here(self._on_query, indirect=False)),
            session.declare_subscriber(f"{root}/in/*/*", here(self._on_lines, indirect=False)),
            session.declare_subscriber(f"{root}/estop", here(self._on_estop, indirect=False)),
            live.declare_subscriber(
                f"{root}/client/*",
                here(functools.partial(self._on_client, session), indirect=False),
                history=True,
            ),
            live.declare_token(f"{root}/live/{self.instance}.{self.instance}"),
        ]
        return self

    def go_away(self) -> None:
        """Ends at once, as a killed process: programs are left as they are."""
        session, self._session = self._session, None
        if session is not None:
            self._events.undeclare()
            session.close()
        self._declared = []

    def come_back(self) -> None:
        """A new start: programs that had not ended are interrupted, answers are forgotten."""
        with self._lock:
            for program in self.programs.values():
                if not program.ended:
                    program.state = "interrupted"
            self._answers.clear()
            self._seq = itertools.count(0)
            self.events = []
        self.instance = ""
        self.start()

    def declare_another(self, name: str) -> None:
        """A token of another machine, which answers nothing."""
        assert self._session is not None
        self._declared.append(self._session.liveliness().declare_token(f"mc/@v1/{name}/live/i1.5e"))

    def lose_link(self) -> None:
        """The link goes and comes again; the server itself has not noticed and its programs live."""
        self.go_away()
        self.start()

    def wait_until(self, condition: Callable[[], bool], timeout_s: float = 10.0) -> None:
        """Blocks until the condition holds after something has happened; fails after the time."""
        deadline = time.monotonic() + timeout_s
        with self._changed:
            while not condition():
                if not self._changed.wait(deadline - time.monotonic()):
                    raise AssertionError("what was waited for has not happened")

    # ------------------------------------------------------------ what tests do to it

    def run_lines(self, program: str, through: int | None = None) -> None:
        """Lines through this number, or all accepted, have ended."""
        with self._lock:
            one = self.programs[program]
            self._run(one, one.accepted if through is None else through)
            self._acknowledge(one)

    def end(self, program: str, state: str, fault: dict[str, Any] | None = None) -> None:
        with self._lock:
            one = self.programs[program]
            one.fault = fault
            self._end(one, state)
            self._acknowledge(one)

    def reject(self, program: str, line: int) -> None:
        """A line that was accepted turns out faulty."""
        with self._lock:
            one = self.programs[program]
            self._reject(one, line)
            self._acknowledge(one)

    def publish_event(self, kind: str, **fields: Any) -> None:
        with self._lock:
            event = {"seq": next(self._seq), "t": 0.0, "instance": self.instance, "kind": kind, **fields}
            self.events.append(event)
            if self._lost("event"):
                return
            self._events.put(msgpack.packb(event), encoding=ENCODING)

    def publish_state(self) -> None:
        self._put("tele/state", self._status())

    def publish_samples(self, rows: bytes, cycles: int) -> None:
        self._put("tele/batch", [self._cycle, self._cycle * 0.001, rows])
        self._cycle += cycles

    # ------------------------------------------------------------ queries

    def _on_query(self, query: zenoh.Query) -> None:
        with self._changed, query:
            client, method = str(query.key_expr).split("/")[-2:]
            self.asked[method] += 1
            self._changed.notify_all()
            if self._lost(f"query:{method}"):
                return
            payload = query.payload
            request = msgpack.unpackb(payload.to_bytes()) if payload is not None else {}
            request["client"] = client
            number = (client, request.get("request", 0))
            answer = self._answers.get(number)
            if answer is None:
                self.calls[method] += 1
                self.requests.append((method, request))
                try:
                    answer = True, msgpack.packb(getattr(self, f"_do_{method}")(request))
                except Refusal as refusal:
                    answer = False, msgpack.packb(refusal.reply)
                self._answers[number] = answer
            if self._lost(f"reply:{method}"):
                return
            ok, reply = answer
            if ok:
                query.reply(query.key_expr, reply, encoding=ENCODING)
            else:
                query.reply_err(reply, encoding=ENCODING)

    def _lost(self, what: str) -> bool:
        if self.lose[what] <= 0:
            return False
        self.lose[what] -= 1
        return True

    # ------------------------------------------------------------ lines

    def _on_lines(self, sample: zenoh.Sample) -> None:
        with self._changed:
            self.asked["in"] += 1
            self._changed.notify_all()
            if self._lost("put"):
                return
            program = self.programs.get(str(sample.key_expr).rpartition("/")[2])
            if program is None:
                return
            first, lines, *rest = msgpack.unpackb(sample.payload.to_bytes())
            of_now = not rest or rest[0] in (None, program.rejections)
            gap = of_now and first > program.accepted + 1
            if of_now and not gap and not program.ended and not program.closed:
                self._take(program, first, lines)
            self._acknowledge(program, expected=program.accepted + 1 if gap else 0)

    def _credit(self, program: FakeProgram) -> int:
        return max(0, self.credit_limit - (program.accepted - program.done))

    def _take(self, program: FakeProgram, first: int, lines: list[str]) -> None:
        new = lines[program.accepted + 1 - first :][: self._credit(program)]
        for text in new:
            number = program.accepted + 1
            if text.startswith(("BAD", "GO")):
                self._reject(program, number)
                break
            program.rejected = 0
            program.accepted = number
            program.texts[number] = text
        if self.runs_by_itself and not program.step and program.state == "running":
            self._run(program, program.accepted)

    def _reject(self, program: FakeProgram, line: int) -> None:
        program.accepted = line - 1
        program.rejected = line
        program.rejections += 1
        program.diagnostics = [
            {
                "code": "MC101",
                "message": "an unknown code",
                "line": line,
                "column": 1,
                "end_column": 4,
                "hint": "use a known one",
            }
        ]
        self.publish_event(
            "line.rejected", program=program.program, line=line, diagnostics=program.diagnostics
        )
        self._end_when_done(program)

    def _run(self, program: FakeProgram, through: int) -> None:
        ended = []
        while program.done < min(through, program.accepted) and not program.ended:
            number = program.done + 1
            text = program.texts.pop(number)
            if text.startswith("FAULT"):
                program.fault = {"code": "MC401", "message": "axis 2 has a fault", "line": number, "axis": 2}
                self._end(program, "faulted")
                break
            self.executed.append((program.program, number, text))
            program.started = program.done = number
            ended.append({"line": number, "start_s": 0.1 * number, "end_s": 0.1 * number + 0.1})
            if text.startswith("M02"):
                program.closed = True
                program.done = program.accepted
        if ended:
            self.publish_event("lines.started", program=program.program, line=program.started)
            self.publish_event("lines.ended", program=program.program, lines=ended)
        self._end_when_done(program)
        self._changed.notify_all()

    def _end_when_done(self, program: FakeProgram) -> None:
        if program.closed and not program.ended and program.done >= program.accepted:
            self._end(program, "finished")

    def _end(self, program: FakeProgram, state: str) -> None:
        program.state = state
        self.publish_event("program.ended", program=program.program, state=state, line=program.done)
        self._changed.notify_all()

    def _acknowledge(self, program: FakeProgram, expected: int = 0) -> None:
        if self._lost("ack"):
            return
        ack: dict[str, Any] = {
            "program": program.program,
            "state": program.state,
            **self._numbers(program),
        }
        if program.rejected:
            ack |= {"rejected": program.rejected, "diagnostics": program.diagnostics}
        if program.fault is not None:
            ack["fault"] = program.fault
        if expected:
            ack["expected"] = expected
        # as the server's: no reply overtakes it
        self._put(f"ack/{program.program}", ack, zenoh.Priority.INTERACTIVE_HIGH)

    # ------------------------------------------------------------ the rest

    def _on_client(self, session: zenoh.Session, sample: zenoh.Sample) -> None:
        with self._changed:
            if session is not self._session:
                # the server's own end, not the client's
                return
            client = str(sample.key_expr).rpartition("/")[2]
            if sample.kind == zenoh.SampleKind.PUT:
                self._clients.add(client)
            else:
                self._clients.discard(client)
                for program in self.programs.values():
                    if program.client == client and not program.ended:
                        self._end(program, "aborted" if program.on_disconnect == "stop" else "finished")
            self._changed.notify_all()

    @property
    def clients(self) -> set[str]:
        with self._lock:
            return set(self._clients)

    def _on_estop(self, _: zenoh.Sample) -> None:
        with self._changed:
            self.estops += 1
            if self.confirm_estop and self.estops > 1:
                self.state = "estop"
                self.publish_event("estop", reason="asked")
            self._changed.notify_all()

    def _program_status(self, program: FakeProgram) -> dict[str, Any]:
        return {
            "progress": 0.0,
            "opened_at": 0.0,
            "program": program.program,
            "state": program.state,
            "client": program.client,
            "name": program.name,
            "axes": program.axes,
            "start_line": program.start_line,
            "line": program.started,
            **self._numbers(program),
            "closed": program.closed,
            "override": program.override,
            "rejected": program.rejected,
            "diagnostics": program.diagnostics if program.rejected else [],
            "fault": program.fault,
        }

    def _status(self) -> dict[str, Any]:
        status = shapes(self.name, self.instance, self.axis_count)["status"]
        status["axes"] |= {
            "position": [1.5] * self.axis_count,
            "homed": [axis not in self.unhomed for axis in range(self.axis_count)],
        }
        programs = [self._program_status(program) for program in self.programs.values()]
        return {**status, "state": self.state, "override": self.override, "programs": programs}

    def _put(self, key: str, message: Any, priority: zenoh.Priority = zenoh.Priority.DATA) -> None:
        if self._session is not None:
            key = f"mc/@v1/{self.name}/{key}"
            self._session.put(key, msgpack.packb(message), encoding=ENCODING, priority=priority)
