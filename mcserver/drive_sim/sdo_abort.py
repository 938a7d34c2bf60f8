"""Abort codes of SDO transfers that a server gives (CiA 301, table 22)."""

from __future__ import annotations

import enum


class Abort(enum.IntEnum):
    """Why a transfer is refused."""

    TOGGLE_BIT = 0x05030000
    COMMAND_SPECIFIER = 0x05040001
    OUT_OF_MEMORY = 0x05040005
    UNSUPPORTED_ACCESS = 0x06010000
    WRITE_ONLY = 0x06010001
    READ_ONLY = 0x06010002
    NO_OBJECT = 0x06020000
    CANNOT_BE_MAPPED = 0x06040041
    PDO_LENGTH_EXCEEDED = 0x06040042
    LENGTH_TOO_HIGH = 0x06070012
    LENGTH_TOO_LOW = 0x06070013
    NO_SUBINDEX = 0x06090011
    INVALID_VALUE = 0x06090030
    VALUE_TOO_HIGH = 0x06090031
    VALUE_TOO_LOW = 0x06090032
    GENERAL = 0x08000000
    NOT_STORED = 0x08000020
    DEVICE_STATE = 0x08000022


class SdoAbort(Exception):
    """A transfer that ends by an abort code."""

    def __init__(self, code: int) -> None:
        super().__init__(f"{code:08X}h")
        self.code = code
