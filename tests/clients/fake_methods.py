"""What the fake server answers: one function for each remote method of the key space."""

from __future__ import annotations

import itertools
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import msgspec

from mcserver.fleet_sim.light_machine import LightMachine

ENDED = ("finished", "aborted", "rejected", "faulted", "interrupted")
QUEUE_LINES = 5000


@dataclass
class FakeProgram:
    """Bookkeeping of one program."""

    program: str
    client: str
    name: str
    axes: list[int]
    start_line: int
    on_disconnect: str
    step: bool
    state: str = "running"
    accepted: int = 0
    done: int = 0
    started: int = 0
    closed: bool = False
    rejected: int = 0
    rejections: int = 0
    diagnostics: list[dict[str, Any]] = field(default_factory=list)
    fault: dict[str, Any] | None = None
    override: float = 100.0
    resume_of: str | None = None
    texts: dict[int, str] = field(default_factory=dict)

    @property
    def ended(self) -> bool:
        return self.state in ENDED


def shapes(name: str, instance: str, axes: int) -> dict[str, dict[str, Any]]:
    """What a machine says of itself, as maps: ``info`` and ``status``."""
    light = LightMachine(
        name,
        instance,
        axes=axes,
        line_s=1.0,
        clock=lambda: 0.0,
        on_ack=lambda _: None,
        on_event=lambda _: None,
    )
    handlers = light.handlers()
    return {what: msgspec.to_builtins(handlers[what]("", None)) for what in ("info", "status")}  # type: ignore[arg-type]


class Refusal(Exception):
    """Becomes an error reply."""

    def __init__(self, code: str, message: str, **more: Any) -> None:
        super().__init__(code)
        self.reply = {"code": code, "message": message, **more}


class FakeMethods:
    """Methods by name, ``_do_`` before it; the rest of the server is `fake_server.FakeServer`."""

    name: str
    instance: str
    axis_count: int
    credit_limit: int
    state: str
    override: float
    programs: dict[str, FakeProgram]
    events: list[dict[str, Any]]
    check_diagnostics: list[dict[str, Any]]
    texts: list[bytes]
    calls: Counter[str]
    _ids: itertools.count[int]

    def _program(self, request: dict[str, Any]) -> FakeProgram:
        program = self.programs.get(request["program"])
        if program is None:
            raise Refusal("MC503", f"no program {request['program']}")
        return program

    def _chosen(self, request: dict[str, Any]) -> list[FakeProgram]:
        if request.get("program") is not None:
            return [self._program(request)]
        return [program for program in self.programs.values() if not program.ended]

    def _do_info(self, _: dict[str, Any]) -> dict[str, Any]:
        info = shapes(self.name, self.instance, self.axis_count)["info"]
        for axis in info["axes"]:
            axis["added_later"] = 1
        info["limits"]["queue_lines"] = QUEUE_LINES
        return info

    def _do_continuation(self, request: dict[str, Any]) -> dict[str, Any]:
        line = request["line"]
        known = {"program": request["program"], "name": "", "state": "aborted", "done": line - 1}
        text = {"accepted": line - 1, "whole": False, "sha256": None, "line": line, "first": line}
        empty = ("lines", "modal", "energize", "axes", "way", "switched", "needs")
        switches = {"block_delete": False, "optional_stop": True}
        return {**known, **text, **switches, **{name: [] for name in empty}}

    def _do_continue_program(self, request: dict[str, Any]) -> dict[str, Any]:
        line = request["line"]
        opened = self._do_open({**request, "start_line": line, "resume_of": request["program"]})
        return {**opened, "line": line, "resume_of": request["program"], "whole": False}

    def _do_open(self, request: dict[str, Any]) -> dict[str, Any]:
        start = request.get("start_line", 1)
        axes = request.get("axes")
        if axes and max(axes) >= self.axis_count:
            raise Refusal("MC507", f"the machine has no axis {max(axes)}", details={"axis": max(axes)})
        program = FakeProgram(
            f"p{next(self._ids)}",
            request["client"],
            request.get("name", ""),
            list(range(self.axis_count)) if axes is None else axes,
            start,
            request.get("on_disconnect", "stop"),
            request.get("step", False),
            accepted=start - 1,
            done=start - 1,
            resume_of=request.get("resume_of"),
            state="held" if request.get("hold") else "running",
        )
        self.programs[program.program] = program
        self.publish_event("program.opened", program=program.program, state=program.state)
        return {
            "program": program.program,
            "state": program.state,
            "axes": program.axes,
            "expected": start,
            "credit": self.credit_limit,
            "instance": self.instance,
        }

    def _do_submit(self, request: dict[str, Any]) -> dict[str, Any]:
        program = self._program(request)
        if program.ended or program.closed or program.state == "ending":
            raise Refusal("MC510", "takes no more lines", details={"state": program.state})
        of_now = request.get("rejections") in (None, program.rejections)
        if not of_now or request["first"] > program.accepted + 1:
            state = {"expected": program.accepted + 1, **self._numbers(program)}
            raise Refusal("MC505", "a gap" if of_now else "of before a rejection", details=state)
        before = program.rejections
        self._take(program, request["first"], request["lines"])
        self._acknowledge(program)
        state = self._numbers(program)
        if program.rejections != before:
            raise Refusal(
                program.diagnostics[0]["code"],
                program.diagnostics[0]["message"],
                details={"expected": program.accepted + 1, **state},
                diagnostics=program.diagnostics,
            )
        return {"program": program.program, **state}

    def _numbers(self, program: FakeProgram) -> dict[str, Any]:
        return {
            "accepted": program.accepted,
            "done": program.done,
            "credit": self._credit(program),
            "rejections": program.rejections,
        }

    def _do_close(self, request: dict[str, Any]) -> dict[str, Any]:
        program = self._program(request)
        if program.state == "interrupted":
            raise Refusal("MC510", "interrupted", details={"state": program.state})
        program.closed = True
        self._end_when_done(program)
        self._acknowledge(program)
        return {
            "program": program.program,
            "accepted": program.accepted,
            "done": program.done,
            "state": program.state,
        }

    def _do_status(self, _: dict[str, Any]) -> dict[str, Any]:
        return self._status()

    def _do_programs(self, request: dict[str, Any]) -> dict[str, Any]:
        wanted = request.get("program")
        if wanted is not None and wanted not in self.programs:
            raise Refusal("MC503", f"no program {wanted}")
        chosen = [program for program in self.programs.values() if wanted in (None, program.program)]
        return {"programs": [self._program_status(program) for program in reversed(chosen)]}

    def _do_hold(self, request: dict[str, Any]) -> dict[str, Any]:
        return self._set_state(request, "held", "program.held")

    def _do_resume(self, request: dict[str, Any]) -> dict[str, Any]:
        return self._set_state(request, "running", "program.resumed")

    def _set_state(self, request: dict[str, Any], state: str, kind: str) -> dict[str, Any]:
        chosen = self._chosen(request)
        for program in chosen:
            program.state = state
            self.publish_event(kind, program=program.program, state=state)
            self._acknowledge(program)
        return {"programs": [program.program for program in chosen]}

    def _do_step(self, request: dict[str, Any]) -> dict[str, Any]:
        program = self._program(request)
        self._run(program, program.done + 1)
        self._acknowledge(program)
        return {"programs": [program.program]}

    def _do_abort(self, request: dict[str, Any]) -> dict[str, Any]:
        chosen = [program for program in self._chosen(request) if not program.ended]
        for program in chosen:
            self._end(program, "aborted")
            self._acknowledge(program)
        return {"programs": [program.program for program in chosen]}

    def _do_leave(self, _: dict[str, Any]) -> dict[str, Any]:
        return {"programs": []}

    def _do_override(self, request: dict[str, Any]) -> dict[str, Any]:
        if not 0.0 <= request["percent"] <= 200.0:
            raise Refusal("MC511", "the override goes from 0 to 200 %")
        chosen = self._chosen(request)
        for program in chosen:
            program.override = request["percent"]
        self.override = request["percent"]
        return {"percent": request["percent"], "programs": [program.program for program in chosen]}

    def _do_jog(self, request: dict[str, Any]) -> dict[str, Any]:
        if request["axis"] >= self.axis_count:
            raise Refusal("MC507", f"the machine has no axis {request['axis']}")
        return {"program": request.get("program") or f"j{next(self._ids)}"}

    def _do_reset(self, _: dict[str, Any]) -> dict[str, Any]:
        self.state = "ready"
        self.publish_event("reset", message="cleared")
        return {"programs": []}

    def _do_check(self, _: dict[str, Any]) -> dict[str, Any]:
        return {"ok": not self.check_diagnostics, "diagnostics": self.check_diagnostics}

    def _do_put_text(self, request: dict[str, Any]) -> dict[str, Any]:
        received = request["offset"] + len(request["part"])
        self.texts.append(request["part"])
        return {"received": received, "lines": 1, "complete": received == request["size"]}

    def _do_simulate(self, _: dict[str, Any]) -> dict[str, Any]:
        return {
            "ok": True,
            "duration_s": 1.0,
            "feed_length_mm": 0.0,
            "axes": {},
            "lines": [],
            "diagnostics": [],
        }

    def _do_events(self, request: dict[str, Any]) -> dict[str, Any]:
        newer = [event for event in self.events if event["seq"] >= request["since"]][: request["limit"]]
        return {
            "instance": self.instance,
            "oldest": self.events[0]["seq"] if self.events else 0,
            "newest": self.events[-1]["seq"] if self.events else 0,
            "events": newer,
        }

    def _do_drives(self, _: dict[str, Any]) -> dict[str, Any]:
        return {
            "drives": [
                {
                    "axis": 2,
                    "kind": "cia402",
                    "bus": "can0",
                    "node": 5,
                    "state": "operational",
                    "nmt": "operational",
                    "heartbeat_age_s": 0.05,
                    "statusword": 0x1637,
                    "status": "operation enabled",
                    "vendor_id": 0x1234,
                    "emergency": "8611h following error",
                    "emergency_code": 0x8611,
                    "emergency_age_s": 2.5,
                    "added_later": 1,
                }
            ]
        }

    def _do_record_start(self, request: dict[str, Any]) -> dict[str, Any]:
        return {"name": f"{request['name']} for {request['max_s']} s"}

    def _do_sdo_read(self, request: dict[str, Any]) -> dict[str, Any]:
        if request["index"] == 0x2345:
            raise Refusal(
                "MC553",
                "axis 2, node 5 on can0: 2345h:00 cannot be read: abort 0602 0000h, object does not exist",
                hint="see the EDS",
                details={"index": 0x2345, "subindex": 0, "abort_code": 0x0602_0000},
            )
        return self._object(request, 0x1637, b"\x37\x16")

    def _do_sdo_write(self, request: dict[str, Any]) -> dict[str, Any]:
        return self._object(request, request["value"], b"\x01")

    def _object(self, request: dict[str, Any], value: Any, raw: bytes) -> dict[str, Any]:
        return {
            "axis": 2 if request["axis"] is None else request["axis"],
            "bus": request["bus"] or "can0",
            "node": request["node"] or 5,
            "index": request["index"],
            "subindex": request["subindex"],
            "type": request["type"] or "u16",
            "value": value,
            "raw": raw,
            "fieldbus": "ethercat" if request["axis"] == 3 else "can",
        }
