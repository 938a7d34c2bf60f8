"""python-can on a bus of the product: another program that the ports have to understand."""

from __future__ import annotations

import can

from mcserver.can.address import Transport, parse_address


def python_can_bus(address: str) -> can.BusABC:
    """The same bus, opened by python-can."""
    where = parse_address(address)
    if where.transport is Transport.SOCKETCAN:
        return can.Bus(where.channel, "socketcan")
    return can.Bus(where.channel, "socketcand", host=where.host, port=where.port, tcp_tune=True)
