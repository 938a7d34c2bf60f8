"""``mcserver drive-sim``: simulated drives as nodes on their CAN buses, with faults on demand."""

from __future__ import annotations

import contextlib
import os
import selectors
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import IO, TYPE_CHECKING, Annotated

import typer

from mcserver.can.address import split_host_port
from mcserver.cli.console import narration, results, show_error
from mcserver.cli.exit_codes import ExitCode
from mcserver.cli.options import MachineOption
from mcserver.cli.serving import require_linux
from mcserver.errors import ConfigurationError, RuntimeFault, UsageFault
from mcserver.machine.drive import CanDrive
from mcserver.machine.families import family_drives
from mcserver.machine.io_process_data import nodes_on
from mcserver.machine.machine_file import Machine, load_machine

if TYPE_CHECKING:
    from mcserver.drive_sim.simulation import Segment

HUB_START_S = 20.0


def drive_sim(
    machine: MachineOption,
    bus: Annotated[
        list[str] | None,
        typer.Option("--bus", metavar="B", help="Only this bus, by its name or address. Repeatable."),
    ] = None,
    node: Annotated[
        list[int] | None, typer.Option("--node", metavar="N", help="Only this node. Repeatable.")
    ] = None,
    hub: Annotated[
        str | None,
        typer.Option(
            "--hub",
            metavar="HOST:PORT",
            help="Run a socketcand hub there, for the buses of the machine file.",
        ),
    ] = None,
    control: Annotated[
        str | None,
        typer.Option(
            "--control", metavar="HOST:PORT", help="Take faults on demand there; port 0 takes a free one."
        ),
    ] = None,
    realtime: Annotated[
        int,
        typer.Option(
            "--realtime", metavar="P", min=0, max=99, help="SCHED_FIFO priority of drives and hub; 0: none."
        ),
    ] = 0,
    interface: Annotated[
        list[str] | None,
        typer.Option(
            "--interface",
            metavar="IF",
            help="Where the master of an EtherCAT bus is connected: not its own. Twice: both ends of a ring.",
        ),
    ] = None,
    wait: Annotated[
        float,
        typer.Option("--wait", min=0.0, max=600.0, help="Wait so long [s] for buses that are not there."),
    ] = 5.0,
) -> None:
    """Simulate the drives of a machine's CAN and EtherCAT buses, until Ctrl-C or SIGTERM."""
    require_linux("a simulated drive's bus")
    described = load_machine(machine)
    hub_address = _address(hub, "--hub")
    control_address = _address(control, "--control")
    _check_choice(described, bus or (), node or ())
    _check_interfaces(described, bus or (), interface or ())
    # only this command needs the packages for drives on a bus
    from mcserver.drive_sim.from_machine import Choice, build_buses

    if realtime:
        _take_priority(realtime)
    choice = Choice(tuple(bus or ()), tuple(node or ()), interface or ())
    with _hub(hub_address) as where:
        try:
            segments = build_buses(described, choice, wait_s=wait)
        except RuntimeFault as error:
            show_error(error)
            raise typer.Exit(int(ExitCode.NOBODY_ANSWERS)) from error
        try:
            _serve(segments, control_address, where)
        finally:
            for segment in segments:
                segment.port.close()
    narration().print(f"{described.name}: simulated drives stopped")


def _serve(segments: Sequence[Segment], control_address: tuple[str, int] | None, hub: str) -> None:
    from mcserver.drive_sim.control import ControlServer
    from mcserver.drive_sim.simulation import DriveSimulation

    simulation = DriveSimulation(segments)
    server = None
    if control_address is not None:
        try:
            server = ControlServer(*control_address, simulation.answer)
        except OSError as error:
            raise RuntimeFault(
                "MC544",
                f"{control_address[0]}:{control_address[1]} cannot be listened on: {error.strerror or error}",
                "give another --control; port 0 takes a free one",
            ) from error
    count = sum(len(segment.nodes) for segment in segments)
    words = [f"READY {count} drives on {', '.join(segment.name for segment in segments)}"]
    if server is not None and control_address is not None:
        words.append(f"control {control_address[0]}:{server.port}")
    if hub:
        words.append(f"hub {hub}")
    try:
        with _stopping_signals(simulation.stop) as bell:
            simulation.switch_on()
            simulation.run(server, lambda: _say(", ".join(words)), bell)
    finally:
        if server is not None:
            server.close()


def _say(line: str) -> None:
    results().print(line)
    sys.stdout.flush()


def _check_choice(machine: Machine, buses: Sequence[str], nodes: Sequence[int]) -> None:
    there_are = [axis.drive.node for axis in machine.axes if isinstance(axis.drive, CanDrive)]
    there_are += [node for bus in machine.buses for node in nodes_on(machine, bus.name)]
    if not there_are:
        kinds = " or ".join(f'"{each.__struct_config__.tag}"' for each in family_drives())
        raise ConfigurationError(
            "MC540",
            f"machine {machine.name} has no drive and no I/O node on a CAN bus",
            f"give axes a [axis.drive] with kind = {kinds}",
        )
    for name in buses:
        if not any(name in (bus.name, bus.address) for bus in machine.buses):
            there = ", ".join(bus.name for bus in machine.buses)
            raise UsageFault("MC541", f"--bus {name}: the machine has no such bus", f"there are {there}")
    for number in nodes:
        if number not in there_are:
            there = ", ".join(str(each) for each in there_are)
            raise UsageFault("MC541", f"--node {number}: the machine has no such node", f"there are {there}")


def _check_interfaces(machine: Machine, buses: Sequence[str], interfaces: Sequence[str]) -> None:
    """Refuse EtherCAT buses without interfaces of their own for the simulation."""
    lines = [
        bus
        for bus in machine.buses
        if bus.kind == "ethercat" and (not buses or bus.name in buses or bus.address in buses)
    ]
    if len(lines) > 1:
        names = ", ".join(bus.name for bus in lines)
        raise UsageFault("MC541", f"{names}: one EtherCAT bus a process", "choose one by --bus")
    of_master = {each for bus in lines for each in (bus.address, bus.redundant_interface) if each}
    if len(of_master) != len(interfaces) or of_master & set(interfaces):
        raise UsageFault(
            "MC541",
            f"--interface {' '.join(interfaces)!r} is not where a master of EtherCAT is connected",
            "give the other end of each of its cables: ip link add ec0 type veth peer name ec1 makes both",
        )


def _take_priority(priority: int) -> None:
    """A real drive does not wait for this computer's other work; the hub inherits the priority."""
    assert sys.platform == "linux"
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except PermissionError as error:
        raise RuntimeFault(
            "MC545",
            f"--realtime {priority}: SCHED_FIFO is not allowed here",
            "see mcserver doctor, or leave the option out",
        ) from error


def _address(text: str | None, option: str) -> tuple[str, int] | None:
    if text is None:
        return None
    try:
        return split_host_port(text)
    except ValueError as error:
        raise UsageFault("MC542", f"{option} {text!r}: {error}", "give HOST:PORT") from None


@contextlib.contextmanager
def _stopping_signals(stop: Callable[[], None]) -> Iterator[int]:
    """SIGTERM and SIGINT call ``stop``; yields a descriptor that has input once one came."""
    reading, writing = os.pipe()
    for end in (reading, writing):
        os.set_blocking(end, False)
    numbers = (signal.SIGTERM, signal.SIGINT)
    before = {number: signal.signal(number, lambda _number, _frame: stop()) for number in numbers}
    woken = signal.set_wakeup_fd(writing)
    try:
        yield reading
    finally:
        signal.set_wakeup_fd(woken)
        for number, handler in before.items():
            signal.signal(number, handler)
        os.close(reading)
        os.close(writing)


@contextlib.contextmanager
def _hub(address: tuple[str, int] | None) -> Iterator[str]:
    """A hub in a process of its own, that ends with this one; yields where it listens."""
    if address is None:
        yield ""
        return
    host = f"[{address[0]}]" if ":" in address[0] else address[0]
    where = f"{host}:{address[1]}"
    process = subprocess.Popen(
        [sys.executable, "-m", "mcserver.can.hub", where, "--until-input-ends"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        # Ctrl-C of a terminal must not take the bus away before the drives have stopped
        start_new_session=True,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        words = _first_line(process.stdout).split()
        if words[:1] != ["READY"]:
            raise RuntimeFault("MC543", f"the hub cannot listen on {where}", "give another --hub")
        yield words[-1]
    finally:
        process.stdin.close()
        process.stdout.close()
        try:
            process.wait(timeout=5.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _first_line(stream: IO[bytes]) -> str:
    """Return what a process says first, empty where it says nothing in time."""
    with selectors.DefaultSelector() as selector:
        selector.register(stream, selectors.EVENT_READ)
        if not selector.select(HUB_START_S):
            return ""
    return stream.readline().decode("utf-8", "replace")
