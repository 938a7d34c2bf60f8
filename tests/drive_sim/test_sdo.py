"""The simulated drive's SDO server, message by message (CiA 301, 7.2.4.3)."""

from __future__ import annotations

import struct

import pytest

from mcserver.can.cob import Function, NmtCommand
from tests.drive_sim.bench import NODE, Aborted, Bench


@pytest.fixture
def bench() -> Bench:
    return Bench().boot()


def test_an_object_is_read_expedited(bench: Bench) -> None:
    assert bench.read(0x1000, 0, "I") == 0x00020192
    assert bench.read(0x6061, 0, "b") == 0
    assert bench.read(0x607D, 1, "i") == -(1 << 31)


def test_what_is_written_is_read_again(bench: Bench) -> None:
    bench.write(0x6065, 0, "I", 1234)
    bench.write(0x605A, 0, "h", 6)
    assert bench.read(0x6065, 0, "I") == 1234
    assert bench.read(0x605A, 0, "h") == 6


def test_a_long_value_is_read_in_segments(bench: Bench) -> None:
    answer = bench.exchange(struct.pack("<BHB4x", 0x40, 0x1008, 0))
    assert answer[0] == 0x41
    size = struct.unpack("<I", answer[4:])[0]
    text, toggle = b"", 0
    for _ in range(20):
        answer = bench.exchange(bytes((0x60 | toggle,)) + bytes(7))
        assert answer[0] & 0x10 == toggle
        text += answer[1 : 8 - (answer[0] >> 1 & 7)]
        toggle ^= 0x10
        if answer[0] & 1:
            break
    assert text == b"Simulated servo drive"
    assert len(text) == size


def test_a_value_is_written_in_segments(bench: Bench) -> None:
    bench.exchange(struct.pack("<BHBI", 0x21, 0x6065, 0, 4))
    assert bench.exchange(b"\x07\x01\x02\x03\x04\x00\x00\x00")[0] == 0x20
    assert bench.read(0x6065, 0, "I") == 0x04030201


@pytest.mark.parametrize(
    ("message", "code"),
    [
        (struct.pack("<BHB4x", 0x40, 0x2000, 0), 0x06020000),
        (struct.pack("<BHB4x", 0x40, 0x1018, 9), 0x06090011),
        (struct.pack("<BHBI", 0x23, 0x1000, 0, 1), 0x06010002),
        (struct.pack("<BHBI", 0x2F, 0x6065, 0, 1), 0x06070013),
        (struct.pack("<BHBI", 0x23, 0x605A, 0, 1), 0x06070012),
        (struct.pack("<BHBH2x", 0x2B, 0x605A, 0, 9), 0x06090031),
        (struct.pack("<BHBh2x", 0x2B, 0x6007, 0, -1), 0x06090032),
        (struct.pack("<BHB4x", 0x60, 0, 0), 0x05040001),
        (struct.pack("<BHB4x", 0xA0, 0x1008, 0), 0x05040001),
        (struct.pack("<BHB4x", 0xE0, 0x1008, 0), 0x05040001),
        (struct.pack("<BHBI", 0x21, 0x6065, 0, 100_000), 0x05040005),
    ],
)
def test_a_request_that_cannot_be_met_is_aborted_by_its_code(bench: Bench, message: bytes, code: int) -> None:
    with pytest.raises(Aborted) as aborted:
        bench.exchange(message)
    assert aborted.value.args == (code,)
    assert bench.read(0x1000, 0, "I") == 0x00020192


def test_an_abort_names_the_object(bench: Bench) -> None:
    bench.receive(Function.SDO_REQUEST + NODE, struct.pack("<BHB4x", 0x40, 0x2345, 6))
    assert bench.taken(Function.SDO_RESPONSE + NODE) == [struct.pack("<BHBI", 0x80, 0x2345, 6, 0x06020000)]


def test_a_toggle_bit_that_does_not_change_ends_the_transfer(bench: Bench) -> None:
    bench.exchange(struct.pack("<BHB4x", 0x40, 0x1008, 0))
    bench.exchange(b"\x60" + bytes(7))
    with pytest.raises(Aborted) as aborted:
        bench.exchange(b"\x60" + bytes(7))
    assert aborted.value.args == (0x05030000,)
    with pytest.raises(Aborted) as again:
        bench.exchange(b"\x70" + bytes(7))
    assert again.value.args == (0x05040001,)


@pytest.mark.parametrize("size", [3, 5])
def test_a_segmented_value_of_another_length_than_announced_is_refused(bench: Bench, size: int) -> None:
    bench.exchange(struct.pack("<BHBI", 0x21, 0x6065, 0, size))
    with pytest.raises(Aborted) as aborted:
        bench.exchange(b"\x07\x01\x02\x03\x04\x00\x00\x00")
    assert aborted.value.args == (0x06070012 if size < 4 else 0x06070013,)


def test_a_message_that_is_no_8_bytes_is_left_out(bench: Bench) -> None:
    bench.receive(Function.SDO_REQUEST + NODE, b"\x40\x00\x10")
    assert bench.taken(Function.SDO_RESPONSE + NODE) == []


def test_a_stopped_node_answers_no_sdo(bench: Bench) -> None:
    bench.nmt(NmtCommand.STOP)
    bench.receive(Function.SDO_REQUEST + NODE, struct.pack("<BHB4x", 0x40, 0x1000, 0))
    assert bench.taken(Function.SDO_RESPONSE + NODE) == []


def test_what_was_stored_outlasts_a_reset_and_the_rest_does_not(bench: Bench) -> None:
    bench.write(0x6065, 0, "I", 1234)
    bench.write(0x1010, 1, "I", int.from_bytes(b"save", "little"))
    bench.write(0x605A, 0, "h", 6)
    before = bench.read(0x1010, 1, "I")
    bench.nmt(NmtCommand.RESET_NODE)
    bench.wait(0.1)
    assert bench.read(0x6065, 0, "I") == 1234
    assert bench.read(0x605A, 0, "h") == 2
    assert (before, bench.read(0x1010, 1, "I")) == (1, 1)


def test_a_store_without_its_signature_is_refused(bench: Bench) -> None:
    bench.write(0x6065, 0, "I", 1234)
    with pytest.raises(Aborted) as caught:
        bench.write(0x1010, 1, "I", 1)
    assert caught.value.args == (0x0800_0020,)
    bench.nmt(NmtCommand.RESET_NODE)
    bench.wait(0.1)
    assert bench.read(0x6065, 0, "I") != 1234
