"""Addresses of CAN buses, as machine files and command lines write them.

====================================  ===================================================================
``can0``, ``socketcan:can0``          an interface of this computer (SocketCAN)
``socketcand:HOST:PORT/CHANNEL``      a channel of a socketcand server, such as `mcserver.can.hub`
``udp:GROUP:PORT``                    a multicast group that carries packets of python-can's udp_multicast
====================================  ===================================================================
"""

from __future__ import annotations

import enum
import ipaddress
import re
import socket
from dataclasses import dataclass

from mcserver.errors import ConfigurationError

REMEDY = (
    "write can0 (an interface of this computer), socketcand:HOST:PORT/CHANNEL, or udp:GROUP:PORT with a "
    "multicast group such as udp:239.74.163.2:43113"
)
# IFNAMSIZ is 16 with the closing zero; socketcand's channels are interfaces, too.
NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,14}")
HOST = re.compile(r"[A-Za-z0-9_]([A-Za-z0-9_.-]{0,252})")


class Transport(enum.Enum):
    """What carries the frames."""

    SOCKETCAN = "socketcan"
    SOCKETCAND = "socketcand"
    UDP = "udp"


@dataclass(frozen=True)
class BusAddress:
    """Where a bus is; `str` gives the one spelling that `parse_address` understands.

    Attributes:
        channel: the interface or the server's channel; empty for `Transport.UDP`.
        host: the server, or the multicast group; empty for `Transport.SOCKETCAN`. port: 0 there.
    """

    transport: Transport
    channel: str = ""
    host: str = ""
    port: int = 0

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        if self.transport is Transport.SOCKETCAN:
            return f"socketcan:{self.channel}"
        if self.transport is Transport.SOCKETCAND:
            return f"socketcand:{host}:{self.port}/{self.channel}"
        return f"udp:{host}:{self.port}"


def parse_address(text: str) -> BusAddress:
    """Return the bus that a text names.

    Raises:
        ConfigurationError: MC009 the text is no address.
    """
    scheme, colon, rest = text.partition(":")
    if not colon:
        return _interface(text, text)
    if scheme == Transport.SOCKETCAN.value:
        return _interface(text, rest)
    if scheme == Transport.SOCKETCAND.value:
        return _server(text, rest)
    if scheme == Transport.UDP.value:
        return _group(text, rest)
    raise _no_address(text, f"nothing is known of {scheme!r}")


def split_host_port(text: str) -> tuple[str, int]:
    """``HOST:PORT``, with an IPv6 host in square brackets.

    Raises:
        ValueError: the text is nothing of the kind; its message says why.
    """
    host, colon, port = text.rpartition(":")
    if not colon:
        raise ValueError("the port is missing")
    if host.startswith("[") and host.endswith("]"):
        host = host[1:-1]
        try:
            ipaddress.IPv6Address(host)
        except ValueError:
            raise ValueError(f"{host!r} is no IPv6 address") from None
    elif not HOST.fullmatch(host):
        raise ValueError(f"{host!r} is no host")
    if not re.fullmatch(r"[0-9]{1,5}", port) or int(port) > 65535:
        raise ValueError(f"{port!r} is no port")
    return host, int(port)


def family_of(host: str) -> socket.AddressFamily:
    """Return the family that a host out of `split_host_port` is listened on in."""
    return socket.AF_INET6 if ":" in host else socket.AF_INET


def _interface(text: str, name: str) -> BusAddress:
    if not NAME.fullmatch(name):
        raise _no_address(text, f"{name!r} is no name of an interface")
    return BusAddress(Transport.SOCKETCAN, channel=name)


def _server(text: str, rest: str) -> BusAddress:
    where, slash, channel = rest.partition("/")
    if not slash or not NAME.fullmatch(channel):
        raise _no_address(text, "the channel is missing" if not channel else f"{channel!r} is no channel")
    host, port = _host_port(text, where)
    return BusAddress(Transport.SOCKETCAND, channel=channel, host=host, port=port)


def _group(text: str, rest: str) -> BusAddress:
    host, port = _host_port(text, rest)
    try:
        multicast = ipaddress.ip_address(host).is_multicast
    except ValueError:
        multicast = False
    if not multicast:
        raise _no_address(text, f"{host!r} is no multicast group")
    return BusAddress(Transport.UDP, host=host, port=port)


def _host_port(text: str, where: str) -> tuple[str, int]:
    try:
        host, port = split_host_port(where)
    except ValueError as error:
        raise _no_address(text, str(error)) from None
    if port == 0:
        raise _no_address(text, "the port is 0")
    return host, port


def _no_address(text: str, why: str) -> ConfigurationError:
    return ConfigurationError("MC009", f"{text!r} is no address of a CAN bus: {why}", REMEDY)
