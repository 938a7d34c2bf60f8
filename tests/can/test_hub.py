"""The hub: who gets a frame, what malformed text brings, and clients that do not read."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator

import can
import pytest

from mcserver.can.hub import MAX_CHANNELS, MAX_QUEUE, Hub, main
from mcserver.can.open import open_port
from mcserver.can.port import EXTENDED
from tests.can.hubs import LIMIT_S, RawClient, address_of, receive, running_hub, wait_until
from tests.can.python_can import python_can_bus


@pytest.fixture
def hub() -> Iterator[Hub]:
    with running_hub() as running:
        yield running


def test_a_frame_goes_to_all_other_clients_of_its_channel_and_to_no_other_channel(hub: Hub) -> None:
    ports = [open_port(address_of(hub, channel)) for channel in ("can0", "can0", "can0", "can1")]
    ports[0].send(0x181, b"\x01")
    ports[3].send(0x182, b"\x02")
    assert [receive(port, 1) for port in ports[1:3]] == [[(0x181, b"\x01")]] * 2
    # a second frame shows that nothing else came in between
    ports[1].send(0x183, b"\x03")
    assert receive(ports[0], 1) == [(0x183, b"\x03")]
    assert ports[3].drain() == []
    for port in ports:
        port.close()


def test_python_can_and_the_port_understand_each_other(hub: Hub) -> None:
    address = address_of(hub)
    port = open_port(address)
    with python_can_bus(address) as bus:
        port.send(0x181, bytes(range(8)))
        port.send(0x080, b"")
        taken = [bus.recv(LIMIT_S), bus.recv(LIMIT_S)]
        assert [(m.arbitration_id, bytes(m.data)) for m in taken if m] == [
            (0x181, bytes(range(8))),
            (0x080, b""),
        ]
        bus.send(can.Message(arbitration_id=0x601, data=[0x40, 0, 0x10, 0xA], is_extended_id=False))
        bus.send(can.Message(arbitration_id=0x80, is_extended_id=False))
        assert receive(port, 2) == [(0x601, b"\x40\x00\x10\x0a"), (0x080, b"")]
    port.close()


def test_python_can_opens_a_bus_on_which_frames_are_passing(hub: Hub) -> None:
    address = address_of(hub)
    port = open_port(address)
    buses = []
    for _ in range(5):
        for count in range(50):
            port.send(0x181, bytes((count,)))
        buses.append(python_can_bus(address))
    port.send(0x182, b"\xff")
    for bus in buses:
        found = iter(lambda bus=bus: bus.recv(LIMIT_S), None)  # type: ignore[misc]
        assert any(message.arbitration_id == 0x182 for message in found)
        bus.shutdown()
    port.close()


def test_extended_frames_pass_between_clients_that_know_them(hub: Hub) -> None:
    port = open_port(address_of(hub))
    with RawClient(hub) as one, RawClient(hub) as other:
        one.enter()
        other.enter()
        one.say("< send 12345678 2 a 1b >< send 123 0 >")
        assert other.hear().split()[:3] == ["<", "frame", "12345678"]
        assert other.hear().split()[:3] == ["<", "frame", "123"]
        assert receive(port, 2) == [(0x12345678 | EXTENDED, b"\x0a\x1b"), (0x123, b"")]
        port.send(0x1200FD01 | EXTENDED, b"\x05")
        assert other.hear().split()[:3] == ["<", "frame", "1200FD01"]
    port.close()


@pytest.mark.parametrize(
    "text",
    [
        "< send 123 3 11 22 >",
        "< send 800 0 >",
        "< send 12 0 >",
        "< send 123 9 1 2 3 4 5 6 7 8 9 >",
        "< send 123 1 gg >",
        "< send >",
        "< dance >",
        ">",
        "x" * 300 + " >",
    ],
)
def test_malformed_text_is_answered_by_an_error_and_the_client_goes_on(hub: Hub, text: str) -> None:
    port = open_port(address_of(hub))
    with RawClient(hub) as client:
        client.enter()
        client.say(text)
        assert client.hear().startswith("< error ")
        client.say("< send 123 1 2 >")
        assert receive(port, 1) == [(0x123, b"\x02")]
    assert hub.counters.malformed == 1
    port.close()


def test_text_without_an_end_is_not_kept(hub: Hub) -> None:
    with RawClient(hub) as client:
        client.enter()
        client.say("< send " * 100)
        assert client.hear() == "< error message too long >"


def test_frames_before_raw_mode_are_refused(hub: Hub) -> None:
    with RawClient(hub) as client:
        assert client.hear() == "< hi >"
        client.say("< send 123 0 >")
        assert client.hear().startswith("< error ")


def test_an_echo_is_answered(hub: Hub) -> None:
    with RawClient(hub) as client:
        client.enter()
        client.say("< echo >")
        assert client.hear() == "< echo >"


def test_only_the_named_channels_can_be_opened() -> None:
    with running_hub("can0", "can1") as hub, RawClient(hub) as client:
        assert client.hear() == "< hi >"
        client.say("< open can2 >")
        assert client.hear() == "< error could not open bus >"
        client.say("< open can1 >")
        assert client.hear() == "< ok >"


def test_a_client_that_does_not_read_is_dropped_and_the_others_go_on(hub: Hub) -> None:
    reader = open_port(address_of(hub))
    sender = open_port(address_of(hub))
    with RawClient(hub, receive_buffer=4096) as sleeper:
        sleeper.enter()
        sent = 0
        frame = sender.prepare(0x100, 8)
        # what the kernel keeps for the sleeper comes on top of the hub's own queue
        while hub.counters.dropped == 0:
            for _ in range(200):
                sent += sender.send_prepared(frame)
            receive(reader, 1)
            assert sent * 40 < 40 * MAX_QUEUE, "the hub queues without bounds"
        assert hub.counters.dropped == 1
        sender.send(0x101, b"\x01")
        wait_until(lambda: (0x101, b"\x01") in reader.drain(), "the others go on")
    reader.close()
    sender.close()


def test_clients_that_hang_up_are_forgotten_and_leave_room_for_other_channels(hub: Hub) -> None:
    def answer_to_one_more() -> str:
        with RawClient(hub) as late:
            assert late.hear() == "< hi >"
            late.say("< open late >")
            return late.hear()

    port = open_port(address_of(hub))
    with contextlib.ExitStack() as here:
        for number in range(1, MAX_CHANNELS):
            here.enter_context(RawClient(hub)).enter(f"can{number}")
        assert answer_to_one_more() == "< error could not open bus >"
    wait_until(lambda: answer_to_one_more() == "< ok >", "the clients are forgotten")
    assert port.send(0x100, b"")
    port.close()


def test_the_hub_serves_ipv6_where_it_is_asked_to() -> None:
    hub = Hub("::1")
    thread = threading.Thread(target=hub.run)
    thread.start()
    port = open_port(f"socketcand:[::1]:{hub.port}/can0")
    assert port.send(0x100, b"")
    port.close()
    hub.stop()
    thread.join(LIMIT_S)


def start_hub(*arguments: str) -> tuple[subprocess.Popen[str], str]:
    process = subprocess.Popen(
        [sys.executable, "-m", "mcserver.can.hub", *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    assert process.stdout is not None
    return process, process.stdout.readline()


def finish(process: subprocess.Popen[str]) -> int:
    try:
        return process.wait(LIMIT_S)
    finally:
        process.kill()
        process.wait()
        for stream in (process.stdin, process.stdout):
            if stream is not None:
                stream.close()


def test_the_hub_as_a_process_says_where_it_is_and_ends_by_sigterm() -> None:
    process, line = start_hub("127.0.0.1:0")
    assert line.startswith("READY hub on 127.0.0.1:")
    port = open_port(f"socketcand:{line.split()[-1]}/can0")
    port.close()
    process.send_signal(signal.SIGTERM)
    assert finish(process) == 0


def test_the_hub_as_a_process_ends_with_whoever_started_it() -> None:
    process, _ = start_hub("127.0.0.1:0", "--until-input-ends")
    assert process.stdin is not None
    process.stdin.close()
    assert finish(process) == 0


def test_an_address_that_is_taken_or_none_gives_an_exit_code(hub: Hub) -> None:
    assert main([f"127.0.0.1:{hub.port}"]) == 1
    with pytest.raises(SystemExit) as ended:
        main(["nowhere"])
    assert ended.value.code == 2
