"""COB-IDs of the predefined connection set (CiA 301, 7.3.5); node numbers are 1 … 127."""

from __future__ import annotations

import enum

NMT = 0x000
SYNC = 0x080
LEAST_NODE = 1
GREATEST_NODE = 127


class Function(enum.IntEnum):
    """Base of a COB-ID; the node's number is added."""

    EMCY = 0x080
    TPDO1 = 0x180
    RPDO1 = 0x200
    TPDO2 = 0x280
    RPDO2 = 0x300
    TPDO3 = 0x380
    RPDO3 = 0x400
    TPDO4 = 0x480
    RPDO4 = 0x500
    SDO_RESPONSE = 0x580
    SDO_REQUEST = 0x600
    HEARTBEAT = 0x700


RPDOS = (Function.RPDO1, Function.RPDO2, Function.RPDO3, Function.RPDO4)
TPDOS = (Function.TPDO1, Function.TPDO2, Function.TPDO3, Function.TPDO4)


class NmtState(enum.IntEnum):
    """State byte of a heartbeat (CiA 301, 7.2.8.3.2.2)."""

    BOOT_UP = 0x00
    STOPPED = 0x04
    OPERATIONAL = 0x05
    PRE_OPERATIONAL = 0x7F


class NmtCommand(enum.IntEnum):
    """Command byte of an NMT message (CiA 301, 7.2.8.2)."""

    START = 0x01
    STOP = 0x02
    ENTER_PRE_OPERATIONAL = 0x80
    RESET_NODE = 0x81
    RESET_COMMUNICATION = 0x82
