"""Addresses of buses: what is understood, and what is refused with a remedy."""

from __future__ import annotations

import pytest

from mcserver.can.address import BusAddress, Transport, parse_address
from mcserver.can.open import open_port
from mcserver.errors import ConfigurationError, RuntimeFault


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("can0", BusAddress(Transport.SOCKETCAN, "can0")),
        ("socketcan:vcan1", BusAddress(Transport.SOCKETCAN, "vcan1")),
        ("socketcand:localhost:29536/can0", BusAddress(Transport.SOCKETCAND, "can0", "localhost", 29536)),
        ("socketcand:[::1]:29536/can0", BusAddress(Transport.SOCKETCAND, "can0", "::1", 29536)),
        ("udp:239.74.163.2:43113", BusAddress(Transport.UDP, "", "239.74.163.2", 43113)),
        ("udp:[ff15::1]:43113", BusAddress(Transport.UDP, "", "ff15::1", 43113)),
    ],
)
def test_an_address_says_transport_host_and_channel(text: str, address: BusAddress) -> None:
    assert parse_address(text) == address


@pytest.mark.parametrize("text", ["can0", "socketcand:[::1]:1/a", "udp:[ff15::1]:2", "udp:224.0.0.1:3"])
def test_an_address_reads_back_as_it_is_written(text: str) -> None:
    assert parse_address(str(parse_address(text))) == parse_address(text)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "can 0",
        "an-interface-too-long",
        "socketcan:",
        "socketcand:localhost/can0",
        "socketcand:localhost:29536",
        "socketcand:localhost:29536/",
        "socketcand:localhost:0/can0",
        "socketcand:localhost:99999/can0",
        "socketcand:::1:29536/can0",
        "udp:127.0.0.1:43113",
        "udp:somewhere:43113",
        "serial:/dev/ttyUSB0",
    ],
)
def test_what_is_no_address_is_refused_with_a_remedy(text: str) -> None:
    with pytest.raises(ConfigurationError) as refused:
        parse_address(text)
    assert refused.value.code == "MC009"
    assert "udp:GROUP:PORT" in refused.value.hint


def test_an_interface_that_is_not_there_cannot_be_opened() -> None:
    with pytest.raises(RuntimeFault) as refused:
        open_port("can-nowhere")
    assert refused.value.code == "MC424"
    assert refused.value.hint
