"""Abort codes, emergency messages and values in words."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mcserver.canopen.abort_codes import abort_remedy, abort_text
from mcserver.canopen.emergency_text import decode_emergency
from mcserver.canopen.values import TYPES, decode_value, encode_value, type_name


def test_an_abort_code_is_shown_as_the_standard_writes_it() -> None:
    assert abort_text(0x06020000) == "abort 0602 0000h, object does not exist"
    assert "manual" in abort_text(0x12345678)
    assert "G1001" in abort_remedy(0x08000022)


def test_an_emergency_says_its_code_its_register_and_the_maker_s_bytes() -> None:
    found = decode_emergency(bytes.fromhex("1186210102030405"))
    assert found is not None
    assert found.text.startswith("8611h following error (register: generic, profile")
    assert found.text.endswith("01 02 03 04 05)")
    assert not found.cleared


def test_an_emergency_may_say_that_all_is_well_again() -> None:
    found = decode_emergency(bytes(8))
    assert found is not None
    assert found.cleared
    assert "no error any more" in found.text


@pytest.mark.parametrize("payload", [b"", b"\x11\x86", bytes(7)])
def test_a_short_emergency_is_none(payload: bytes) -> None:
    assert decode_emergency(payload) is None


@pytest.mark.parametrize(
    ("name", "value", "raw"),
    [
        ("u8", 255, "ff"),
        ("i16", -2, "feff"),
        ("u16", "0x10", "1000"),
        ("i24", -1, "ffffff"),
        ("u32", 2**32 - 1, "ffffffff"),
        ("i64", -1, "ff" * 8),
        ("f32", "1.5", "0000c03f"),
        ("f64", 1, "000000000000f03f"),
        ("bool", True, "01"),
        ("str", "save", "73617665"),
        ("bytes", "01 fF", "01ff"),
    ],
)
def test_values_become_bytes(name: str, value: int | float | str | bool, raw: str) -> None:
    assert encode_value(name, value).hex() == raw


@pytest.mark.parametrize(
    ("name", "value"),
    [("u8", 256), ("u8", -1), ("i8", 128), ("u16", "ten"), ("u16", 1.5), ("bytes", "0g"), ("u64", 2**64)],
)
def test_values_that_do_not_fit_are_refused(name: str, value: int | float | str) -> None:
    with pytest.raises(ValueError, match=r"."):
        encode_value(name, value)


def test_bytes_of_another_length_are_no_value() -> None:
    with pytest.raises(ValueError, match="u16 has 2 bytes, the drive gave 4"):
        decode_value("u16", bytes(4))


@given(st.sampled_from([name for name in TYPES if name[0] in "iu" and name[1:].isdecimal()]), st.data())
def test_whole_numbers_come_back_from_their_bytes(name: str, data: st.DataObject) -> None:
    bits = int(name[1:])
    low, high = (-(1 << (bits - 1)), (1 << (bits - 1)) - 1) if name[0] == "i" else (0, (1 << bits) - 1)
    value = data.draw(st.integers(low, high))
    assert decode_value(name, encode_value(name, value)) == value


@given(st.floats(width=32, allow_nan=False))
def test_short_floats_come_back_from_their_bytes(value: float) -> None:
    found = decode_value("f32", encode_value("f32", value))
    assert found == value
    assert math.copysign(1.0, float(found)) == math.copysign(1.0, value)


def test_every_type_of_the_standard_has_a_name() -> None:
    assert type_name(0x7) == "u32"
    assert type_name(0xF) == "bytes"
    assert type_name(None) == "bytes"
