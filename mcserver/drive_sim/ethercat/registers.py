"""Registers of an EtherCAT slave controller (ETG.1000.4), by their physical addresses."""

from __future__ import annotations

import enum

TYPE = 0x0000
STATION_ADDRESS = 0x0010
DL_STATUS = 0x0110
AL_CONTROL = 0x0120
AL_STATUS = 0x0130
AL_STATUS_CODE = 0x0134
WATCHDOG_DIVIDER = 0x0400
WATCHDOG_PROCESS_DATA = 0x0420
EEPROM_CONTROL = 0x0502
EEPROM_ADDRESS = 0x0504
EEPROM_DATA = 0x0508
FMMU = 0x0600
SYNC_MANAGER = 0x0800
RECEIVE_TIMES = 0x0900
SYSTEM_TIME = 0x0910
RECEIVE_TIME_UNIT = 0x0918
SYSTEM_TIME_OFFSET = 0x0920
PROCESS_MEMORY = 0x1000

FMMU_SIZE, FMMUS = 16, 8
SYNC_MANAGER_SIZE, SYNC_MANAGERS = 8, 8
# of a sync manager: its status and its activation
SM_STATUS, SM_ACTIVATE = 5, 6
MAILBOX_FULL = 0x08
# activation of the sync manager of the mailbox for the master; behind it the slave's own control
MAILBOX_IN_ACTIVATE = SYNC_MANAGER + SYNC_MANAGER_SIZE + SM_ACTIVATE
REPEAT = 0x02
# DL status by open cables in front and behind: links, loops and communication of four ports
PORTS = {(False, False): 0x5A31, (False, True): 0x5611, (True, False): 0x5921, (True, True): 0x5501}
# of the watchdog [ns]
WATCHDOG_UNIT_NS = 40


class AlState(enum.IntEnum):
    """States of the application layer (ETG.1000.6)."""

    INIT = 1
    PREOP = 2
    BOOT = 3
    SAFEOP = 4
    OP = 8


class AlCode(enum.IntEnum):
    """AL status codes (ETG.1000.6, table 11) that the simulation gives."""

    NONE = 0x0000
    INVALID_STATE_CHANGE = 0x0011
    UNKNOWN_STATE = 0x0012
    BOOT_NOT_SUPPORTED = 0x0013
    INVALID_MAILBOX = 0x0016
    WATCHDOG = 0x001B
    INVALID_OUTPUTS = 0x001D
    INVALID_INPUTS = 0x001E


ERROR = 0x10
