"""What can go wrong with a drive or its bus: how it is brought about, and how it shows."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass

from mcclient import Machine, RequestRefused

from mcserver.can.cob import NMT, Function, NmtCommand
from mcserver.can.open import open_port
from mcserver.drives.cia402.loops import AGAINST_SHARE
from mcserver.drives.cia402.profile_position import NEW_SETPOINT
from mcserver.drives.node_watch import HEARTBEAT_PATIENCE
from tests.e2e_can.bench import CYCLE_HZ, NODE, VICTIM
from tests.e2e_can.cell import Cell
from tests.e2e_can.machines import FOLLOWING_MM
from tests.e2e_can.signs import (
    Behind,
    InFrames,
    NoFrames,
    Sign,
    commanded,
    commanded_otherwise,
    has,
    lacks_answer,
    lacks_heartbeat,
    pulls,
    short_answer,
)

# defaults of the machine file
HEARTBEAT_MS = 100
SILENCE_CYCLES = 3
OVERDUE_S = HEARTBEAT_PATIENCE * HEARTBEAT_MS / 1e3
SHORT = SILENCE_CYCLES - 1
LONG = 10 * SILENCE_CYCLES
OVERCURRENT = 0x2310
FOLLOWING = 0x8611
INTERPOLATION = 0x60C2
STATUSWORD = 0x6041
LATE_ANSWER_S = 1.0
STARTED = "drive.started"
ON_ITS_BUS = (0, 1)
AGAINST_PERMILLE = round(1000 * AGAINST_SHARE)

Act = Callable[[Cell], object]


@dataclass(frozen=True)
class Disturbance:
    """One thing that goes wrong, at the victim.

    Attributes:
        name: in the table.
        inject, undo: in another thread than the loop's. sign: None where the motion goes on to its end.
        meanwhile: what a client does then; gives what it was answered.
        concerned: axes that have the fault.
        returns: kind of the event that says that the drive can be energized again; empty: at once.
        at_rest: it shows only when the drive is energized.
        mode: of the victim's drive. afterwards: what a client does once it is over.
    """

    name: str
    inject: Act
    undo: Act
    sign: Sign | None
    meanwhile: Callable[[Machine], Awaitable[str]] | None = None
    concerned: tuple[int, ...] = (VICTIM,)
    returns: str = ""
    at_rest: bool = False
    mode: str = "csp"
    afterwards: Callable[[Machine], Awaitable[object]] | None = None


def ask(fault: str, **values: float) -> Act:
    """A request to the victim's simulated drive."""

    def request(cell: Cell) -> None:
        cell.drives_of(NODE).control.fault(NODE, fault, **values)

    return request


def frame(identifier: int, payload: bytes) -> Act:
    """A frame on the victim's bus, as another master or a faulty node would send it."""

    def send(cell: Cell) -> None:
        port = open_port(cell.addresses[0])
        try:
            port.send(identifier, payload)
        finally:
            port.close()

    return send


def reboot_with(fault: str, **values: float) -> Act:
    """The drive boots, and its configuration goes wrong."""

    def both(cell: Cell) -> None:
        ask(fault, **values)(cell)
        ask("reboot")(cell)

    return both


def nothing(_: Cell) -> None:
    """It ends by itself."""


async def read_an_object(machine: Machine) -> str:
    """As `mcctl` does; gives the code of the refusal."""
    try:
        await machine.sdo_read(STATUSWORD, axis=VICTIM)
    except RequestRefused as refused:
        return refused.code
    return ""


async def slow_down(machine: Machine) -> str:
    """Another speed is another set-point of a drive that goes to points."""
    await machine.override(50.0)
    return ""


async def full_speed(machine: Machine) -> None:
    await machine.override(100.0)


CLEAR = ask("clear")
ANSWER = InFrames(lambda: lacks_answer(NODE))


def emergency(code: int) -> Sign:
    """An EMCY frame with that code."""
    return InFrames(lambda: has(Function.EMCY + NODE, code.to_bytes(2, "little")))


def disturbances(cycle_hz: float = CYCLE_HZ) -> tuple[Disturbance, ...]:
    """All of them, in the order of the table."""
    overdue = InFrames(lambda: lacks_heartbeat(NODE, round(OVERDUE_S * cycle_hz)))
    return (
        Disturbance("mute", ask("mute"), CLEAR, ANSWER),
        Disturbance(f"TPDO {SHORT} cycles late", ask("late_tpdo", syncs=SHORT), CLEAR, None),
        Disturbance(f"TPDO {LONG} cycles late", ask("late_tpdo", syncs=LONG), CLEAR, ANSWER),
        Disturbance("short TPDO", ask("short_tpdo"), CLEAR, InFrames(lambda: short_answer(NODE))),
        Disturbance("EMCY, overcurrent", ask("emcy", code=OVERCURRENT), CLEAR, emergency(OVERCURRENT)),
        Disturbance(
            "controlword ignored",
            ask("stuck"),
            CLEAR,
            InFrames(lambda: commanded_otherwise(NODE)),
            at_rest=True,
        ),
        Disturbance("SDO aborted", ask("sdo_abort", index=STATUSWORD), CLEAR, None, meanwhile=read_an_object),
        Disturbance(
            "SDO answered late",
            ask("sdo_delay", seconds=LATE_ANSWER_S),
            CLEAR,
            None,
            meanwhile=read_an_object,
        ),
        Disturbance("reboot", ask("reboot"), nothing, ANSWER, returns=STARTED),
        Disturbance(
            "reboot, then SDO aborted",
            reboot_with("sdo_abort", index=INTERPOLATION),
            CLEAR,
            ANSWER,
            returns=STARTED,
        ),
        Disturbance(
            "reboot, then SDO answered late",
            reboot_with("sdo_delay", seconds=LATE_ANSWER_S),
            CLEAR,
            ANSWER,
            returns=STARTED,
        ),
        Disturbance(
            "NMT stop by another master",
            frame(NMT, bytes((NmtCommand.STOP, NODE))),
            nothing,
            ANSWER,
            returns=STARTED,
        ),
        Disturbance("EMCY, no error any more", frame(Function.EMCY + NODE, bytes(8)), nothing, None),
        Disturbance("heartbeat stops", ask("heartbeat_stop"), CLEAR, overdue),
        Disturbance("shaft jams", ask("following_error"), CLEAR, Behind(VICTIM, FOLLOWING_MM)),
        Disturbance(
            "following error of the drive", ask("following_error", trip=1), CLEAR, emergency(FOLLOWING)
        ),
        Disturbance(f"{SHORT} SYNCs missed", ask("drop_sync", syncs=SHORT), nothing, None),
        Disturbance(f"{LONG} SYNCs missed", ask("drop_sync", syncs=LONG), nothing, ANSWER),
        Disturbance(
            "process killed",
            lambda cell: cell.kill_drives(NODE),
            lambda cell: cell.start_drives([NODE]),
            ANSWER,
            returns=STARTED,
        ),
        Disturbance(
            "bus away",
            lambda cell: cell.stop_hub(0),
            lambda cell: cell.start_hub(0),
            NoFrames(),
            concerned=ON_ITS_BUS,
            returns="bus.back",
        ),
    )


def disturbances_of_modes() -> tuple[Disturbance, ...]:
    """What is different, or worth a look, where the victim's drive goes to points or gets torques."""
    reboot = ("reboot", ask("reboot"), nothing, ANSWER)
    both = {
        "mute": (ask("mute"), CLEAR, ANSWER),
        "EMCY, overcurrent": (ask("emcy", code=OVERCURRENT), CLEAR, emergency(OVERCURRENT)),
        f"{SHORT} SYNCs missed": (ask("drop_sync", syncs=SHORT), nothing, None),
        "shaft jams": (ask("following_error"), CLEAR, Behind(VICTIM, FOLLOWING_MM)),
    }
    rows = []
    for mode in ("pp", "cst"):
        rows += [Disturbance(f"{mode}: {name}", *parts, mode=mode) for name, parts in both.items()]
        name, inject, undo, sign = reboot
        rows.append(Disturbance(f"{mode}: {name}", inject, undo, sign, mode=mode, returns=STARTED))
    rows += [
        Disturbance(
            "pp: set-point not acknowledged",
            ask("ignore_setpoints"),
            CLEAR,
            InFrames(lambda: commanded(NODE, NEW_SETPOINT)),
            meanwhile=slow_down,
            afterwards=full_speed,
            mode="pp",
        ),
        Disturbance(
            f"cst: TPDO {LONG} cycles late",
            ask("late_tpdo", syncs=LONG),
            CLEAR,
            ANSWER,
            mode="cst",
        ),
        Disturbance(
            "cst: torque the wrong way round",
            ask("reverse_torque"),
            CLEAR,
            InFrames(lambda: pulls(NODE, AGAINST_PERMILLE)),
            mode="cst",
        ),
        Disturbance(
            "cst: process killed",
            lambda cell: cell.kill_drives(NODE),
            lambda cell: cell.start_drives([NODE]),
            ANSWER,
            returns=STARTED,
            mode="cst",
        ),
    ]
    return tuple(rows)
