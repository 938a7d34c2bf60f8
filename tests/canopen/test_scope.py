"""The scope: rows around a trigger, written as MCAP, drawn."""

from __future__ import annotations

import io
import math
import struct
import threading
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from mcserver.can.cob import SYNC, Function
from mcserver.can.pdo import MappedObject, MappedPdo, ProcessData
from mcserver.canopen import scope_recording
from mcserver.canopen.cycle_samples import Signal, signals_of
from mcserver.canopen.dictionary import generic_dictionary
from mcserver.canopen.scope import Scope, ScopeTrace, Trigger, find_signal, read_trigger
from mcserver.canopen.settings import settings_of
from mcserver.errors import RuntimeFault, UsageFault
from mcserver.plot.scope_picture import draw_scope, panels_of
from mcserver.recorder.scope_file import field_names, write_scope
from tests.canopen.fake_drives import FakeDrives
from tests.canopen.rig import Desk, machine_on

Make = Callable[..., FakeDrives]
Capture = pytest.CaptureFixture[str]
TPDO, SLOW, RPDO = 0x183, 0x283, 0x203
DATA = ProcessData(
    (MappedPdo(1, RPDO, (MappedObject(0x607A, 0, 32),), 1),),
    (
        MappedPdo(1, TPDO, (MappedObject(0x6041, 0, 16), MappedObject(0x6064, 0, 32)), 1),
        MappedPdo(2, SLOW, (MappedObject(0x6077, 0, 16), MappedObject(0x6079, 0, 32)), 10),
    ),
)
COUNTS_PER_MM = 409.6


def signals() -> list[Signal]:
    """Target, statusword, position, torque and voltage of an axis with 4096 counts for 10 mm."""
    return signals_of(machine_on("can0", [3]).axes[0], DATA, generic_dictionary(3))


def cycle(target_mm: float, reading_mm: float) -> list[tuple[int, bytes]]:
    target, reading = (struct.pack("<i", round(each * COUNTS_PER_MM)) for each in (target_mm, reading_mm))
    return [(RPDO, target), (SYNC, b""), (TPDO, b"\x37\x02" + reading)]


def recorded(
    positions: Sequence[float], cycles: int, before: int, trigger: Trigger | None
) -> tuple[Scope, bool]:
    """A scope that has seen readings at these positions, each on its setpoint."""
    scope = Scope(signals(), 0.01, cycles, before, trigger)
    frames = [frame for each in positions for frame in cycle(each, each)] + [(SYNC, b"")]
    done = False
    for identifier, payload in frames:
        done = done or scope.take(identifier, payload)
    return scope, done


RISING = Trigger(2, 1.5, above=True)


def test_a_trigger_keeps_what_came_before_it() -> None:
    scope, done = recorded([0, 0, 0, 1, 2, 3, 4, 5, 6, 7], 6, 2, RISING)
    assert done
    trace = scope.trace()
    assert trace.time_s == pytest.approx([-0.02, -0.01, 0.0, 0.01, 0.02, 0.03])
    assert trace.values[:, 2] == pytest.approx([0, 1, 2, 3, 4, 5], abs=0.01)


def test_a_trigger_soon_after_the_begin_has_less_before_it() -> None:
    scope, _ = recorded([0, 2, 3, 4], 3, 50, RISING)
    assert scope.trace().time_s == pytest.approx([-0.01, 0.0, 0.01])


def test_an_edge_needs_the_other_side_first_and_a_level_does_not() -> None:
    scope, done = recorded([5, 5, 5, 5], 2, 0, RISING)
    assert not done
    assert not scope.triggered
    scope, done = recorded([5, 5, 5, 5], 2, 0, Trigger(2, 1.5, above=True, edge=False))
    assert done
    assert scope.trace().time_s[0] == 0.0


def test_a_falling_edge_fires_below_its_level() -> None:
    scope, done = recorded([0, 5, 3, 1, 0, 0], 2, 0, Trigger(2, 2.0, above=False))
    assert done
    assert scope.trace().values[0, 2] == pytest.approx(1, abs=0.01)


def test_a_trigger_waits_over_cycles_without_a_reading() -> None:
    scope = Scope(signals(), 0.01, 1, 0, RISING)
    frames = [*cycle(0, 0), (SYNC, b""), (SYNC, b""), *cycle(0, 2), (SYNC, b"")]
    assert [scope.take(*frame) for frame in frames][-1]


def test_the_following_error_is_a_signal_that_triggers() -> None:
    scope = Scope(signals(), 0.01, 2, 1, Trigger(len(signals()), 0.5, above=True))
    frames = [*cycle(0, 0), *cycle(1, 0), *cycle(2, 0), *cycle(2, 2), (SYNC, b"")]
    done = [scope.take(*frame) for frame in frames]
    assert done[-1]
    trace = scope.trace()
    assert trace.names[-1] == "following error"
    assert trace.values[:, -1] == pytest.approx([math.nan, 1.0], abs=0.01, nan_ok=True)


def test_a_scope_keeps_no_more_than_it_was_asked_for() -> None:
    scope, done = recorded([0] * 500, 10, 100, Trigger(2, 1.0, above=True))
    assert not done
    assert scope.rows == 500
    assert len(scope._before) == 101
    scope, _ = recorded([0] * 500, 10, 0, None)
    assert len(scope.trace().time_s) == 10


@pytest.mark.parametrize(
    ("text", "column", "level", "above"),
    [
        ("Position actual value > 2", 2, 2.0, True),
        ("6064<-1.5e1", 2, -15.0, False),
        ("6064h:00 > +.5", 2, 0.5, True),
        ("target > 1", 0, 1.0, True),
        ("following error>0.05", 5, 0.05, True),
    ],
)
def test_a_trigger_is_a_name_a_comparison_and_a_level(
    text: str, column: int, level: float, above: bool
) -> None:
    assert read_trigger(text, signals(), edge=True) == Trigger(column, level, above)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "6064",
        "6064 >",
        "> 2",
        "6064 = 2",
        "6064 > many",
        "6064 > 1.2.3",
        "6065 > 1",
        "a > 1",
        "value > 1",
    ],
)
def test_a_trigger_that_makes_no_sense_is_refused(text: str) -> None:
    with pytest.raises(UsageFault, match="MC568"):
        read_trigger(text, signals(), edge=True)


def test_an_object_that_is_not_mapped_is_refused_with_what_is_and_how_to_get_more() -> None:
    with pytest.raises(UsageFault) as caught:
        find_signal("temperature", signals())
    assert "torque actual value" in caught.value.hint
    assert "monitor" in caught.value.hint


# ------------------------------------------------------------ files


def a_trace() -> ScopeTrace:
    time_s = (np.arange(5000) - 100.0) * 0.001
    values = np.stack([np.sin(time_s), np.full(len(time_s), np.nan), np.cos(time_s)], axis=1)
    names = ("Position actual value", "Time", "Größe (neu)")
    return ScopeTrace(2, names, ("mm", "", "N·m"), ("6064h:00", "2000h:01", "2001h:00"), time_s, values)


def test_every_cycle_is_read_back_from_the_file_by_others() -> None:
    trace = a_trace()
    stream = io.BytesIO()
    write_scope(stream, trace, "cell", 1_700_000_000.0)
    stream.seek(0)
    reader = make_reader(stream, decoder_factories=[DecoderFactory()])
    messages = list(reader.iter_decoded_messages())
    assert len(messages) == len(trace.time_s)
    _, channel, message, decoded = messages[4999]
    assert channel.topic == "/scope/axis_2"
    assert channel.metadata["units"] == "mm\n\nN·m"
    assert message.log_time == 1_700_000_000_000_000_000 + 4_899_000_000
    assert decoded.time == pytest.approx(4.899)
    first, silent, last = (getattr(decoded, name) for name in field_names(trace))
    assert (first, last) == (trace.values[4999, 0], trace.values[4999, 2])
    assert math.isnan(silent)


def test_fields_have_names_of_protobuf_each_once() -> None:
    names = field_names(a_trace())
    assert names[:2] == ["position_actual_value", "time_2000h_01"]
    assert len({*names}) == 3
    assert all(name.isascii() and name.isidentifier() for name in names)


def test_a_picture_has_signals_of_a_unit_together_and_none_that_never_came() -> None:
    scope, _ = recorded([0, 1, 2, 3, 4], 4, 0, None)
    trace = scope.trace()
    assert [name for name, _ in panels_of(trace)] == ["Position [mm]", "Following error [mm]"]
    stream = io.BytesIO()
    draw_scope(trace, stream, "cell: axis 0")
    assert stream.getvalue().startswith(b"\x89PNG")


# ------------------------------------------------------------ the command


@pytest.fixture
def cycling(make_drives: Make) -> object:
    """A server and a drive that moves up and down, as far as frames go."""
    drives = make_drives(3)
    stopping = threading.Event()

    def run() -> None:
        at = 0
        while not stopping.wait(0.002):
            at += 1
            reading = struct.pack("<Hbi", 0x237, 8, round(COUNTS_PER_MM * (at % 50)))
            for identifier, payload in (
                (RPDO, struct.pack("<Hbi", 15, 8, 0)),
                (SYNC, b""),
                (Function.TPDO1 + 3, reading),
            ):
                drives.send(identifier, payload)

    thread = threading.Thread(target=run)
    thread.start()
    yield drives
    stopping.set()
    thread.join()


def test_the_command_records_around_a_trigger_draws_and_sends_nothing(
    desk: Desk, cycling: FakeDrives
) -> None:
    output, picture = desk.folder / "s.mcap", desk.folder / "s.png"
    code, said = desk(
        *("scope", "0", "--trigger", "position actual > 20", "--seconds", "0.4", "--before", "0.1"),
        *("-o", str(output), "--plot", str(picture)),
    )
    assert (code, said["cycles"]) == (0, 40)
    shown = {each["name"]: each for each in said["signals"]}
    assert shown["Position actual value"]["unit"] == "mm"
    assert shown["Position actual value"]["greatest"] == pytest.approx(49, abs=0.1)
    assert picture.read_bytes().startswith(b"\x89PNG")
    with output.open("rb") as stream:
        assert len(list(make_reader(stream).iter_messages())) == 40
    assert cycling.heard == {}


def test_a_trigger_that_does_not_come_leaves_no_file(desk: Desk, cycling: FakeDrives) -> None:
    output = desk.folder / "s.mcap"
    code, said = desk(
        *("scope", "0", "--trigger", "position actual > 99", "--timeout", "0.3"),
        *("-o", str(output)),
    )
    assert (code, said["diagnostics"][0]["code"]) == (1, "MC569")
    assert not output.exists()
    assert cycling.heard == {}


@pytest.mark.parametrize("others", [[], [(Function.HEARTBEAT + 1, b"\x05")]], ids=["silent", "heartbeats"])
def test_a_cycle_that_ends_ends_the_recording_too(
    monkeypatch: pytest.MonkeyPatch, others: list[tuple[int, bytes]]
) -> None:
    monkeypatch.setattr(scope_recording, "NO_SYNC_S", 0.1)
    cycles = [[(SYNC, b"")] for _ in range(5)]
    port: Any = SimpleNamespace(fileno=lambda: -1, drain=lambda: cycles.pop() if cycles else others)
    (drive,) = settings_of(machine_on("socketcand:127.0.0.1:9/can0", [1]))
    with pytest.raises(RuntimeFault, match=r"MC569.*the cycle ended"):
        scope_recording.record_cycles(port, drive, Scope(signals(), 0.01, 1000, 0, None), 1e6)


def test_without_a_cycle_there_is_nothing_to_record(desk: Desk) -> None:
    code, said = desk("scope", "0", "-o", str(desk.folder / "s.mcap"))
    assert (code, said["diagnostics"][0]["code"]) == (1, "MC569")
    assert "no SYNC" in said["diagnostics"][0]["message"]


@pytest.mark.parametrize(
    "options",
    [("--seconds", "0"), ("--seconds", "nan"), ("--seconds", "1e9"), ("--before", "3"), ("--timeout", "inf")],
)
def test_durations_that_cannot_be_are_refused(desk: Desk, options: tuple[str, str]) -> None:
    assert desk.refusal("scope", "0", *options, "-o", str(desk.folder / "s.mcap")) == (2, "MC017")
