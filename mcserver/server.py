"""The server: one machine, its executor, its service and its face on the network, from start to stop."""

from __future__ import annotations

import asyncio
import contextlib
import datetime
import logging
import secrets
import signal
import sys
import time
from collections.abc import AsyncIterator, Callable
from functools import partial
from pathlib import Path

import msgspec

from mcserver.canopen.booted_drives import CanDrives, booted
from mcserver.canopen.canopen_errors import Stopped
from mcserver.canopen.drive_events import CanopenEvent
from mcserver.errors import ServiceError
from mcserver.executor.client import ExecutorProcess
from mcserver.machine.machine_file import Machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.motion.compiling import COMPILING_EXECUTOR, needs_compiler
from mcserver.net.configuration import NetworkOptions
from mcserver.net.endpoint import MachineEndpoint
from mcserver.planning.client import ProcessPlanning
from mcserver.processes import freeze_heap
from mcserver.recorder.client import RecorderClient, recorder_for
from mcserver.security.expiry import CODE as EXPIRY_CODE
from mcserver.security.expiry import authority_of, warn_of_expiry
from mcserver.service.event_log import EventLog
from mcserver.service.executor_port import ExecutorPort
from mcserver.service.jog import Jogging
from mcserver.service.references import References, references_file
from mcserver.service.reports import Event
from mcserver.service.service import MachineService
from mcserver.service.service_options import LoadedFile, ServiceOptions, state_folder
from mcserver.service.work_offsets import WorkOffsets, offsets_file
from mcserver.simulation.program_checker import ProgramChecker

log = logging.getLogger(__name__)

# The journal and the planner's messages are Python beside the loop: with the default of 5 ms a call could
# wait so long.
SWITCH_INTERVAL_S = 0.0005

# Makes the recorder of a start: its instance, the journal, and where it reports trouble.
MakeRecorder = Callable[[str, Path, Callable[[], EventLog]], RecorderClient | None]


class ServerOptions(msgspec.Struct, frozen=True):
    """How a server runs.

    Attributes:
        network: endpoints.
        journal: the journal's file; None: the machine's own under the user's state folder.
        on_ready: called once with the endpoints, when clients are answered.
        on_progress: called with a sentence while drives on CAN buses boot; in any thread.
        take_over: reset the drives on CAN buses even where another master is heard.
        machine_file: that was loaded; None: a built-in machine.
    """

    network: NetworkOptions = NetworkOptions()
    journal: Path | None = None
    on_ready: Callable[[list[str]], None] | None = None
    on_progress: Callable[[str], None] | None = None
    take_over: bool = False
    machine_file: LoadedFile | None = None


def default_journal(machine: str) -> Path:
    """Return the machine's journal in the state folder."""
    return state_folder() / f"{machine}.db"


def publish_drive_event(events: EventLog, event: CanopenEvent) -> None:
    """Publish what happened to a drive on a CAN bus besides the cycle."""
    events.publish(event.kind, axis=event.axis, reason=event.code, message=event.message)


async def _warn_of_expiry(file: Path, events: EventLog) -> None:
    await warn_of_expiry(file, partial(events.warn, EXPIRY_CODE), lambda: datetime.datetime.now(datetime.UTC))


@contextlib.asynccontextmanager
async def running(
    machine: Machine,
    options: ServerOptions,
    port: ExecutorPort,
    planning: ProcessPlanning,
    drives: CanDrives | None = None,
    make_recorder: MakeRecorder | None = None,
) -> AsyncIterator[tuple[MachineService, MachineEndpoint]]:
    """A server that answers inside the block, and is stopped in order at its end.

    Raises:
        ServiceError: MC520 the journal, MC521 or MC522 the network.
    """
    journal = options.journal or default_journal(machine.name)
    try:
        journal.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        raise ServiceError(
            "MC520", f"the journal's folder {journal.parent} cannot be made: {error}", "give --journal"
        ) from error
    instance = f"{int(time.time()):x}{secrets.token_hex(3)}"
    async with contextlib.AsyncExitStack() as stack:
        stack.callback(port.close)
        face = await MachineEndpoint.open(machine.name, options.network)
        stack.push_async_callback(face.close)
        recorder = None
        if make_recorder is not None:
            recorder = make_recorder(instance, journal, lambda: service.events)

        def on_event(event: Event) -> None:
            face.publish_event(event)
            if recorder is not None:
                recorder.on_event(event)

        service = MachineService(
            machine,
            port,
            planning,
            ServiceOptions(
                journal=journal,
                instance=instance,
                authority=authority_of(options.network.config_file),
                machine_file=options.machine_file,
            ),
            on_ack=face.publish_ack,
            on_event=on_event,
        )
        if recorder is not None:
            # behind the service's end: its last events are recorded too
            stack.push_async_callback(recorder.close)
        stack.push_async_callback(service.stop)
        checker = ProgramChecker(machine)
        stack.callback(checker.close)
        service.start()
        if options.network.config_file is not None:
            watching = asyncio.create_task(_warn_of_expiry(options.network.config_file, service.events))
            stack.callback(watching.cancel)
        if drives is not None:
            stack.enter_context(drives.published(partial(publish_drive_event, service.events)))
        face.serve(
            service,
            Jogging(service, build_kinematics(machine)),
            checker,
            None if drives is None else drives.access,
            recorder,
        )
        if recorder is not None:
            recorder.start()
        yield service, face


async def serve(machine: Machine, options: ServerOptions | None = None) -> None:
    """Run until SIGTERM or SIGINT: then motion stops along its paths, axes are released, the journal is
    closed.

    Raises:
        ServiceError: MC518 the executor does not start or has died, MC520, MC521, MC522.
        ConfigurationError: MC008, MC016, MC552. RuntimeFault: MC422 the executor or MC436 the planner does
            not come up, MC424 a CAN bus, MC550 … MC555 a drive on it.
    """
    options = options or ServerOptions()
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    freeze_heap()
    loop = asyncio.get_running_loop()
    stopping = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, stopping.set)
    on_progress = options.on_progress or log.info
    try:
        # drives leave operation only when the executor has released them
        async with (
            booted(machine, on_progress, stopping.is_set, take_over=options.take_over) as drives,
            contextlib.AsyncExitStack() as stack,
        ):
            journal = options.journal or default_journal(machine.name)
            references = References(references_file(journal), machine).holding
            tool = WorkOffsets(offsets_file(journal)).tool
            executor = ExecutorProcess(drives.machine or machine, references=references, tool=tool)
            if needs_compiler():
                on_progress(COMPILING_EXECUTOR)
            executor.launch()
            stack.callback(executor.stop)
            planning = ProcessPlanning(machine, executor)
            stack.callback(planning.close)
            if executor.mailboxes is not None:
                from mcserver.ethercat.operator_line import OperatorLine

                drives.reach(OperatorLine(machine, executor.mailboxes))
            await asyncio.to_thread(executor.wait)
            await asyncio.to_thread(planning.wait)
            port = ExecutorPort(machine, executor)
            _, face = await stack.enter_async_context(
                running(machine, options, port, planning, drives, partial(recorder_for, machine, executor))
            )
            if options.on_ready is not None:
                options.on_ready(await face.endpoints())
            await _until_stopped(stopping, port)
    except Stopped:
        return
    finally:
        for number in (signal.SIGTERM, signal.SIGINT):
            loop.remove_signal_handler(number)


async def _until_stopped(stopping: asyncio.Event, port: ExecutorPort) -> None:
    while not stopping.is_set():
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(stopping.wait(), 0.2)
        if not port.alive():
            raise ServiceError(
                "MC518",
                f"the executor process has died ({port.ending()}); the drives stop by their own heartbeat "
                "time-out",
                "start the server again; axes have to be captured anew",
            )
