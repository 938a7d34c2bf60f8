"""A machine: the client's entrance."""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import os
import weakref
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from mcclient.calls import DEADLINE_S, Caller
from mcclient.discovery import CONNECT_S, find_machine, new_client_id
from mcclient.errors import MotionError, ProtocolError, closed_client
from mcclient.estop import send_until_confirmed
from mcclient.events import open_events
from mcclient.feed import Feed, Queue
from mcclient.keys import PROTOCOL_VERSION, Keys, live_key
from mcclient.machine_calls import MachineCalls
from mcclient.parts import read_parts
from mcclient.presence import Presence
from mcclient.program import Program
from mcclient.reports import Report, open_reports
from mcclient.servo import COUNTS_S, Servo
from mcclient.starting import Starting
from mcclient.stream import LineStream
from mcclient.telemetry import SAMPLES_LIMIT, STATES_LIMIT, Samples, decode_samples, open_feed
from mcclient.texts import put_text
from mcclient.transport import Link, Subscription, endpoints_of, user_of
from mcclient.types import (
    Continuation,
    ContinueReply,
    Event,
    EventsReply,
    Info,
    MachineStatus,
    OnDisconnectWord,
    OpenReply,
    OutputsWord,
)
from mcclient.wire import decode

T = TypeVar("T")

PATIENCE_S = 10.0
EVENTS_A_PAGE = 1000
LEAVE_S = 1.0
GRACE_S = 10.0


class Machine(MachineCalls):
    """A connected machine.

    Attributes:
        name: the machine's.
        client: this client's id.
    """

    def __init__(self, link: Link, keys: Keys, presence: Presence, caller: Caller, patience_s: float) -> None:
        self.name = keys.machine
        self.client = keys.client
        self._link = link
        self._keys = keys
        self._presence = presence
        self._caller = caller
        self._patience_s = patience_s
        self._info: Info | None = None
        self._watch: Subscription | None = None
        self._asking_anew: asyncio.Task[None] | None = None
        self._token_declared = False
        self._streams: weakref.WeakSet[LineStream] = weakref.WeakSet()
        self._feeds: weakref.WeakSet[Feed[Any]] = weakref.WeakSet()

    @classmethod
    def connect(
        cls,
        name: str | None = None,
        connect: str | Sequence[str] | None = None,
        *,
        client: str = "py",
        timeout_s: float = CONNECT_S,
        patience_s: float = PATIENCE_S,
        config_file: Path | None = None,
    ) -> Starting[Machine]:
        """Finds the machine and connects to it.

        Args:
            name: the machine's; None: the environment's MC_MACHINE, else the only one that is there.
            connect: Zenoh endpoints of a server or router, such as ``tcp/10.0.0.5:7447``; None: MC_CONNECT,
                else this computer.
            client: what the client's id begins with, behind the user whom ``config_file`` names.
            timeout_s: how long to look for the machine.
            patience_s: how long a program waits for a server that has gone away.
            config_file: a Zenoh configuration (JSON5), for TLS and passwords.

        Raises (when awaited or entered):
            NobodyAnswers: MC530. SeveralMachines: MC531. ConfigurationError: MC537. ProtocolError: MC533.
        """
        named = name or os.environ.get("MC_MACHINE") or None
        endpoints = endpoints_of(connect)
        return Starting(lambda: cls._open(named, endpoints, client, timeout_s, patience_s, config_file))

    @classmethod
    async def _open(
        cls,
        name: str | None,
        endpoints: tuple[str, ...],
        client: str,
        timeout_s: float,
        patience_s: float,
        config_file: Path | None,
    ) -> Machine:
        if name is not None:
            # a name that cannot be one is refused before anything is waited for
            live_key(name)
        client_id = new_client_id(client, user_of(config_file))
        link = await Link.open(endpoints, timeout_s=timeout_s, config_file=config_file)
        try:
            keys = Keys(await find_machine(link, name, timeout_s=timeout_s), client_id)
            presence = Presence(keys.machine)
            link.believe(presence.is_server)
            machine = cls(link, keys, presence, Caller(link, keys, presence), patience_s)
            await machine._begin(timeout_s)
        except BaseException:
            await link.close()
            raise
        return machine

    async def _begin(self, timeout_s: float) -> None:
        self._watch = self._link.watch_tokens(self._keys.live, self._presence.on_token)
        await self._presence.wait_online(timeout_s)
        info = await self.refresh_info(deadline_s=max(timeout_s, DEADLINE_S))
        if info.protocol and PROTOCOL_VERSION not in info.protocol:
            raise ProtocolError(
                "MC533",
                f"{self.name} speaks protocol {list(info.protocol)}, this client {PROTOCOL_VERSION}",
                "install the mcclient that belongs to the server",
            )
        self._presence.on_return(self._on_server_return)

    def _on_server_return(self, instance: str) -> None:
        for stream in list(self._streams):
            stream.on_server_return()
        if instance != self.info.instance:
            if self._asking_anew is not None:
                self._asking_anew.cancel()
            self._asking_anew = asyncio.get_running_loop().create_task(self._ask_anew())

    async def _ask_anew(self) -> None:
        """Learn what a server that was started again is now: its machine file may be another one."""
        # one that goes away meanwhile is asked when it comes back
        with contextlib.suppress(MotionError):
            await self.refresh_info()

    async def close(self) -> None:
        """Ends the link; programs still open end as their ``on_disconnect`` says, without their grace."""
        if self._asking_anew is not None:
            self._asking_anew.cancel()
            await asyncio.gather(self._asking_anew, return_exceptions=True)
        left = [stream for stream in self._streams if not stream.ended]
        for stream in list(self._streams):
            await stream.stop(closed_client())
        if left and self.online:
            # a server that does not hear it sees the token go
            with contextlib.suppress(MotionError):
                await self._caller.call("leave", deadline_s=LEAVE_S)
        if self._watch is not None:
            self._watch.close()
        for feed in list(self._feeds):
            feed.close()
        await self._link.close()

    async def __aenter__(self) -> Machine:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    # ------------------------------------------------------------ what it is and does

    @property
    def info(self) -> Info:
        """Axes, limits, tools, units; asked for anew when the server was started again."""
        assert self._info is not None, "set before a machine is handed out"
        return self._info

    @property
    def online(self) -> bool:
        """Whether the server is there now."""
        return self._presence.online

    @property
    def instance(self) -> str:
        """Which start of the server is there now, as states and events name it; empty: none is."""
        server = self._presence.server
        return "" if server is None else server.instance

    async def refresh_info(self, *, deadline_s: float = DEADLINE_S) -> Info:
        """Asks again now; after a start of the server that is done anyway."""
        self._info = await self.ask_info(deadline_s=deadline_s)
        return self._info

    # ------------------------------------------------------------ programs

    def program(
        self,
        name: str = "",
        axes: Sequence[int] | None = None,
        *,
        on_disconnect: OnDisconnectWord = "stop",
        grace_s: float = GRACE_S,
        start_line: int = 1,
        before: Sequence[str] = (),
        step: bool = False,
        block_delete: bool | None = None,
        optional_stop: bool | None = None,
        hold: bool = False,
        text: str | None = None,
        sha256: str | None = None,
        at_pause: bool = False,
        way: bool = False,
        outputs: OutputsWord | None = None,
    ) -> Starting[Program]:
        """Opens a program: ``async with machine.program() as program``.

        At the end of the block it is finished, or aborted when the block raises. ``await machine.program()``
        opens it without a block.

        Args:
            name: for people: a file's name.
            axes: the axes to lease; None: all of the machine. It waits in order for axes that others have.
            on_disconnect: ``stop`` or ``finish`` what is accepted, when this client's link goes.
            grace_s: how long the link may be away before that; a client that is back within it goes on.
            start_line: number of the first line.
            before: the lines 1 … start_line - 1. They do not run: what they energize is energized, modal
                state is as behind them, and the axes go to where they end, as `continue_program` says.
            step: a line starts only when `Program.step` asks for it.
            block_delete: lines that begin with ``/`` are skipped; without it they are carried out.
            optional_stop: False: M01 does not pause.
            hold: begin held.
            text: all of it, if known: once `simulate` was called with it, before or after, the program's
                status tells how long it takes. It has to be sent all the same.
            sha256: of all of it, instead of ``text``; for one that `put_text` hands over, before or after.
            at_pause: run now, also on axes of a program that stands at a pause, such as to set zero with a
                new tool; refused (MC512) where it would have to wait.
            way: as of `continue_program`.
            outputs: as of `continue_program`.
        """
        known = sha256 if text is None else self.hash_of(text)

        async def opened() -> Program:
            return self._followed(
                await self.open_program(
                    name[:200],
                    axes=axes,
                    on_disconnect=on_disconnect,
                    grace_s=grace_s,
                    start_line=start_line,
                    before=before,
                    step=step,
                    block_delete=block_delete,
                    optional_stop=optional_stop,
                    hold=hold,
                    sha256=known,
                    at_pause=at_pause,
                    way=way,
                    outputs=outputs,
                )
            )

        return Starting(opened)

    def continue_program(
        self,
        program: str,
        *,
        line: int | None = None,
        way: bool = False,
        outputs: OutputsWord | None = None,
        on_disconnect: OnDisconnectWord = "stop",
        grace_s: float = GRACE_S,
        hold: bool = False,
        show: Callable[[Continuation], object] | None = None,
    ) -> Starting[Program]:
        """Goes on with a program that has ended: ``async with machine.continue_program(id) as program``.

        The server energizes what the program had energized, brings the axes to where the line starts (to a
        safe height, over, down, where its machine file names one), and runs the lines that its journal has.
        Where its text was not whole, send the lines behind ``program.given_through``.

        Args:
            line: the first that runs; None: the one behind the last that is done.
            way: axes may go the way that `continuation` shows, where the machine file names none.
            outputs: ``set`` what the program had switched (spindle, coolant), or ``leave`` it.
            show: gets what ran, where the axes stand and where the program has them, before anything moves;
                where it raises, nothing does.

        Raises (when awaited or entered):
            RequestRefused: MC450, MC592, MC593, MC594: what has to be done or said first; nothing has moved.
        """

        async def opened() -> Program:
            if show is not None:
                show(await self.continuation(program, line=line))
            return self._followed(
                await self.open_continuation(
                    program,
                    line=line,
                    way=way,
                    outputs=outputs,
                    on_disconnect=on_disconnect,
                    grace_s=grace_s,
                    hold=hold,
                )
            )

        return Starting(opened)

    def _followed(self, opened: OpenReply | ContinueReply) -> Program:
        stream = LineStream(
            opened, link=self._link, keys=self._keys, caller=self._caller, patience_s=self._patience_s
        )
        self._streams.add(stream)
        return Program(
            stream,
            axes=opened.axes,
            caller=self._caller,
            open_reports=self._open_reports,
            max_line_length=self.info.limits.max_line_length,
            patience_s=self._patience_s,
        )

    def servo(
        self,
        axes: Sequence[int] | None = None,
        *,
        name: str = "",
        within: Mapping[int, tuple[float, float]] | None = None,
        counts_s: float = COUNTS_S,
        armed: bool = False,
    ) -> Starting[Servo]:
        """Lets axes follow targets: ``async with machine.servo([0, 1]) as servo``, then ``servo.send``.

        They are energized and leased. At the end of the block they come to rest on the last targets; where
        the block raises, at once.

        Args:
            axes: all free now; None: all of the machine.
            name: for people.
            within: of each axis the least and the greatest position that targets lead it to [mm or deg]. A
                machine with bodies or zones needs them, and the program ends as faulted at once where these
                would not stay clear everywhere between.
            counts_s: how long each message counts, up to 10 s: without a newer one by then the axes stop, and
                the program ends.
            armed: inside of what an operator has approved for a while, as it is for agents (`arm`).

        Raises (when awaited or entered):
            RequestRefused: MC512 an axis is leased, MC595 the machine has bodies or zones, and ``within`` is
                not given; MC327 ``within`` does not fit the axes; MC608 ``armed``, and nothing is approved.
        """

        async def opened() -> Servo:
            low, high = (
                None if within is None else {axis: both[side] for axis, both in within.items()}
                for side in (0, 1)
            )
            opening = self.servo_armed if armed else self.open_servo
            reply = await opening(axes, name=name[:200], low=low, high=high)
            return Servo(
                reply,
                link=self._link,
                keys=self._keys,
                calls=self,
                counts_s=counts_s,
                on_return=self._presence.on_return,
            )

        return Starting(opened)

    # ------------------------------------------------------------ the operator's part

    async def estop(self, reason: str = "", *, timeout_s: float = 5.0) -> None:
        """Emergency stop; returns once the server has confirmed. No safety function: see `mcclient.estop`.

        Raises:
            NoAnswerInTime: MC532.
        """
        await send_until_confirmed(self._link, self._keys, reason=reason, timeout_s=timeout_s)

    # ------------------------------------------------------------ without motion

    @staticmethod
    def hash_of(text: str) -> str:
        """Return the SHA-256 by which the server knows a text."""
        return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()

    async def put_text(self, path: Path, sha256: str | None = None) -> str:
        """Hands a long program over as a file, for `check` and for the times of programs that run it.

        Args:
            sha256: of it, where that is known.

        Returns:
            Its SHA-256. Raises as `mcclient.texts.put_text`.
        """
        return await put_text(self._caller, path, sha256)

    async def read_mesh(self, mesh: int) -> bytes:
        """Take a mesh's file over; ``mesh`` counts from 0 in ``(await model()).meshes``.

        Raises:
            RequestRefused: MC587 it is not to be had. ProtocolError: MC533 it has changed meanwhile.
        """
        parts = read_parts(f"the mesh {mesh}", lambda offset: self.model_mesh(mesh, offset))
        return b"".join([data async for data, _ in parts])

    def read_recording(self, name: str) -> AsyncIterator[tuple[bytes, int]]:
        """The file of a recording piece by piece: bytes, and the size of the whole.

        Raises:
            RequestRefused: MC585 no recording has that name. ProtocolError: MC533 it has changed meanwhile.
        """
        return read_parts(f"the recording {name}", lambda offset: self.recording_read(name, offset))

    async def clients(self, *, timeout_s: float = 1.0) -> list[str]:
        """Ids of the clients that are connected and have opened a program of this machine, sorted."""
        found = await self._link.live_keys(self._keys.tokens, timeout_s=timeout_s)
        return sorted({key.rpartition("/")[2] for key in found})

    # ------------------------------------------------------------ what it tells

    def telemetry(self) -> Feed[MachineStatus]:
        """Return the whole machine some 20 times a second, for dashboards: ``async for state in
        machine.telemetry()``.
        """
        read = partial(decode, MachineStatus)
        return self._kept(open_feed(self._link, self._keys.state, read, limit=STATES_LIMIT))

    def samples(self) -> Feed[Samples]:
        """Return every cycle of every axis, some cycles at a time, as arrays."""
        return self._kept(
            open_feed(
                self._link,
                self._keys.samples,
                lambda payload: decode_samples(payload, self.info),
                limit=SAMPLES_LIMIT,
            )
        )

    def events(self, *, history: bool = False) -> Feed[Event]:
        """Events in order and without gap, from now on; ``history``: those that the server still has come
        first.
        """
        found: Feed[Event] = open_events(
            self._link, self._keys.event, self._event_page, Queue.push, history=history
        )
        return self._kept(found)

    def _open_reports(self, program: str) -> Feed[Report]:
        return self._kept(open_reports(self._link, self._keys.event, self._event_page, program))

    def _kept(self, feed: Feed[T]) -> Feed[T]:
        """Return a feed that ends with the machine."""
        self._feeds.add(feed)
        return feed

    async def _event_page(self, since: int) -> EventsReply:
        return await self.past_events(since, limit=EVENTS_A_PAGE)

    def _declare_token(self) -> None:
        """Before the first program or request: the server ends those whose token has gone."""
        if not self._token_declared:
            self._link.declare_token(self._keys.token)
            self._token_declared = True
