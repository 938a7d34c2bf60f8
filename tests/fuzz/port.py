"""Raw bytes at the port of `mcserver run` while a program runs: ``make fuzz ARGS="--target port"``.

Noise, handshakes of a real client with changes, replayed or changed on their way, connections that say
nothing or something slowly, and lengths that never come. The program has to go on, or be held by a warning
MC525 where Zenoh has panicked; setpoints have to stay within the axis's limits, the server has to answer
between the inputs, and its processes have to be the same at the end.
"""

from __future__ import annotations

import contextlib
import random
import socket
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import msgspec
import numpy as np
import zenoh

from tests.bench.server import client_config
from tests.e2e.conftest import slower
from tests.e2e.servers import ServerProcess
from tests.fuzz.mutation import mutated

ANSWER_S = 5.0
# until a server whose Zenoh has panicked answers this client again, which comes back by itself
BACK_S = 30.0
PAUSE_S = 0.1
LOOK_EVERY = 25
OPEN_AT_ONCE = 200
PROGRAM = ["G1010 P0", *["G01 X5 F3000", "G01 X0"] * 5000]
FAILURES = ("Traceback", "MC516", "MC019")
PANIC, DEAF, STALLED = "panicked", "MC525", "MC459"
# of the built-in machine's linear axes [mm/s, mm/s²]; positions come as float32 [mm]
VELOCITY, ACCELERATION, ROUNDING = 1000.0, 10_000.0, 1e-5


class Setpoints:
    """What an axis was told, cycle by cycle, judged by its limits; all of it in Zenoh's thread."""

    def __init__(self, cycle_s: float, axes: int, fields: int) -> None:
        self.cycles = 0
        self.worst_velocity = self.worst_acceleration = 0.0
        self._cycle_s = cycle_s
        self._shape = (-1, axes, fields)
        self._last: tuple[int, float] | None = None

    def take(self, payload: bytes) -> None:
        """Take one batch; where some were lost, the way in between was no longer than its time allows."""
        first, _, rows = msgspec.msgpack.decode(payload)
        positions = np.frombuffer(rows, "<f4").reshape(self._shape)[:, 0, 0].astype(float)
        if self._last is not None and first > self._last[0]:
            self._see((positions[0] - self._last[1]) / ((first - self._last[0]) * self._cycle_s))
        velocities = np.diff(positions) / self._cycle_s
        for velocity in velocities:
            self._see(velocity)
        steps = np.abs(np.diff(velocities)) / self._cycle_s
        self.worst_acceleration = max(self.worst_acceleration, *steps, 0.0)
        self.cycles += len(positions)
        self._last = (first + len(positions) - 1, positions[-1])

    def _see(self, velocity: float) -> None:
        self.worst_velocity = max(self.worst_velocity, abs(velocity))

    def wrong(self) -> str:
        """What was beyond the limits; empty: nothing."""
        noise = 2.0 * ROUNDING / self._cycle_s
        if self.worst_velocity > 1.001 * VELOCITY + noise:
            return f"the axis was told {self.worst_velocity:.1f} mm/s"
        if self.worst_acceleration > 1.05 * ACCELERATION + 2.0 * noise / self._cycle_s:
            return f"the axis was told {self.worst_acceleration:.0f} mm/s²"
        return ""


class Machine:
    """A server whose program runs, and a client of it that watches."""

    def __init__(self, server: ServerProcess) -> None:
        self.server = server
        self.address = ("127.0.0.1", int(server.endpoint.rpartition(":")[2]))
        self._session = zenoh.open(client_config(server.endpoint))
        self._numbers = iter(range(1, 1 << 40))
        self._program = ""
        self._axis: Setpoints | None = None
        self.held = self.stalled = 0
        self.longest_s = 0.0
        self.processes = (server.pid, *server.executors())

    def ask(self, method: str, **fields: Any) -> dict[str, Any]:
        """Call a method; again where no answer comes.

        Raises:
            TimeoutError: none came within `BACK_S`.
        """
        payload = msgspec.msgpack.encode({"request": next(self._numbers), **fields})
        asked = time.monotonic()
        # without a link there is no answer at once
        while (waited := time.monotonic() - asked) < BACK_S:
            replies = self._session.get(
                f"mc/@v1/cell/@rpc/fuzz-watcher/{method}", payload=payload, timeout=ANSWER_S
            )
            for reply in replies:
                if reply.ok is not None:
                    self.longest_s = max(self.longest_s, waited)
                    answer: dict[str, Any] = msgspec.msgpack.decode(reply.ok.payload.to_bytes())
                    return answer
            time.sleep(PAUSE_S)
        raise TimeoutError(f"{method} was not answered")

    def look(self) -> str:
        """See that the server answers and the program runs; what is wrong, empty: nothing."""
        try:
            if self._axis is None:
                self._axis = self._watched_axis()
            status = self.ask("status")
            if status["faults"] and all(each["code"] == STALLED for each in status["faults"]):
                # beside other work the executor may get no core: it has said so, and stopped
                self.stalled += 1
                self.ask("reset")
                self._program = ""
                return ""
            if status["state"] != "ready":
                return f"the machine is in {status['state']}: {status['faults']}"
            if not self._program:
                self._program = self.ask("open", axes=[0], on_disconnect="finish")["program"]
                self.ask("submit", program=self._program, first=1, lines=PROGRAM)
            (program,) = self.ask("programs", program=self._program)["programs"]
            if program["state"] == "held":
                if not any(DEAF in line and self._program in line for line in self.server.said):
                    return "the program is held, and nobody has said why"
                self.held += 1
                self.ask("resume", program=self._program)
            elif program["state"] == "finished":
                self._program = ""
            elif program["state"] not in ("running", "waiting"):
                return f"the program is {program['state']}"
        except TimeoutError as error:
            return f"{error}\n{''.join(self.server.said[-400:])}"
        if (self.server.pid, *self.server.executors()) != self.processes:
            return "a process was replaced"
        return self._axis.wrong() or self._failure()

    def _watched_axis(self) -> Setpoints:
        info = self.ask("info")
        axis = Setpoints(info["cycle_s"], len(info["axes"]), len(info["telemetry"]["fields"]))
        self._session.declare_subscriber(
            "mc/@v1/cell/tele/batch",
            zenoh.handlers.Callback(lambda sample: axis.take(sample.payload.to_bytes()), indirect=False),
        )
        return axis

    def told(self) -> str:
        """What the run has seen."""
        said = "".join(self.server.said)
        assert self._axis is not None
        return (
            f"Zenoh panicked {said.count(PANIC)} times, {said.count(DEAF)} other sessions were opened, "
            f"the program was held {self.held} times, the executor had no core {self.stalled} times, "
            f"an answer took {self.longest_s:.1f} s at most; "
            f"{self._axis.cycles} cycles, at most "
            f"{self._axis.worst_velocity:.1f} mm/s and {self._axis.worst_acceleration:.0f} mm/s²"
        )

    def _failure(self) -> str:
        said = "".join(self.server.said)
        found = min((said.find(word) for word in FAILURES if word in said), default=-1)
        return "" if found < 0 else f"the server said:\n{said[max(0, found - 100) : found + 2000]}"

    def close(self) -> None:
        self._session.close()  # type: ignore[no-untyped-call]


class Middle(threading.Thread):
    """Carries one client's connection to the server, and changes what the client sends from a piece on.

    Args:
        draw: of the changes; None: only records. untouched: pieces that pass as they are.
    """

    def __init__(self, address: tuple[str, int], draw: random.Random | None, untouched: int) -> None:
        super().__init__(daemon=True)
        self.pieces: list[bytes] = []
        self._address = address
        self._draw = draw
        self._untouched = untouched
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.settimeout(ANSWER_S)
        self.endpoint = f"tcp/127.0.0.1:{self._listener.getsockname()[1]}"

    def run(self) -> None:
        with self._listener, contextlib.suppress(OSError):
            client, _ = self._listener.accept()
            with client, socket.create_connection(self._address) as server:
                back = threading.Thread(target=_carry, args=(server, client), daemon=True)
                back.start()
                while piece := client.recv(65536):
                    self.pieces.append(piece)
                    if self._draw is not None and len(self.pieces) > self._untouched:
                        piece = mutated(self._draw, [piece])
                    server.sendall(piece)


def _carry(source: socket.socket, sink: socket.socket) -> None:
    with contextlib.suppress(OSError):
        while piece := source.recv(65536):
            sink.sendall(piece)


def talk(endpoint: str) -> None:
    """What a client says: it connects, asks, puts and listens."""
    config = client_config(endpoint)
    config.insert_json5("connect/timeout_ms", "300")
    with contextlib.suppress(zenoh.ZError), zenoh.open(config) as session:
        session.liveliness().declare_token("mc/@v1/cell/client/fuzzed")
        session.declare_subscriber("mc/@v1/cell/tele/**", lambda _: None)
        session.put("mc/@v1/cell/in/fuzzed/p-1", msgspec.msgpack.encode([1, ["G01 X1"]]))
        for key in ("mc/@v1/cell/info", "mc/@v1/cell/@rpc/fuzzed/status"):
            session.get(key, lambda _: None, timeout=0.2)
        time.sleep(0.02)


def long_batch(draw: random.Random, said: bytes) -> bytes:
    """The head of a batch of Zenoh, which begins with its length, and less than that."""
    length = draw.choice((0, 1, 0x7FFF, 0xFFFF)).to_bytes(2, "little")
    return length + said[2:][: draw.randrange(1, 64)]


class Inputs:
    """One input after the other, of all kinds.

    Args:
        talks: what clients say at the port, given its endpoint. long: begins what is longer than what comes.
    """

    def __init__(
        self,
        address: tuple[str, int],
        seed: int,
        *,
        in_session: bool,
        talks: Sequence[Callable[[str], None]] = (talk,),
        long: Callable[[random.Random, bytes], bytes] = long_batch,
    ) -> None:
        self.counts: Counter[str] = Counter()
        self._address = address
        self._seed = seed
        self._talks, self._begin_of_long = talks, long
        self._open: list[socket.socket] = []
        self._said = [self._recorded(each) for each in talks]
        self._kinds: tuple[Callable[[random.Random], None], ...] = (
            self._noise,
            self._replayed,
            self._replayed,
            self._silent,
            self._slow,
            self._long,
            *((self._changed, self._changed) if in_session else ()),
        )

    def _recorded(self, talk: Callable[[str], None]) -> list[bytes]:
        middle = Middle(self._address, None, 0)
        middle.start()
        talk(middle.endpoint)
        return middle.pieces

    def send(self, number: int) -> str:
        """Send one input, the same for the same seed but for what the server answers; gives its kind."""
        draw = random.Random(f"{self._seed}/port/{number}")
        kind = draw.choice(self._kinds)
        with contextlib.suppress(OSError):
            kind(draw)
        self.counts[kind.__name__] += 1
        while len(self._open) > OPEN_AT_ONCE:
            self._open.pop(draw.randrange(len(self._open))).close()
        return kind.__name__

    def close(self) -> None:
        for each in self._open:
            each.close()

    def _connected(self) -> socket.socket:
        made = socket.create_connection(self._address, timeout=ANSWER_S)
        self._open.append(made)
        return made

    def _noise(self, draw: random.Random) -> None:
        self._connected().sendall(draw.randbytes(draw.randrange(1, 70_000)))

    def _replayed(self, draw: random.Random) -> None:
        connection = self._connected()
        for piece in draw.choice(self._said):
            connection.sendall(mutated(draw, [piece]) if draw.random() < 0.5 else piece)

    def _changed(self, draw: random.Random) -> None:
        middle = Middle(self._address, draw, draw.randrange(6))
        middle.start()
        draw.choice(self._talks)(middle.endpoint)

    def _silent(self, _: random.Random) -> None:
        self._connected()

    def _slow(self, draw: random.Random) -> None:
        # one more byte for each connection that is open
        for connection in self._open:
            with contextlib.suppress(OSError):
                connection.sendall(draw.randbytes(1))

    def _long(self, draw: random.Random) -> None:
        self._connected().sendall(self._begin_of_long(draw, draw.choice(draw.choice(self._said) or [b""])))


@contextmanager
def machine() -> Iterator[Machine]:
    """A server of its own in a folder of its own."""
    with TemporaryDirectory() as folder:
        server = ServerProcess(Path(folder), slower(Path(folder), "cartesian"), "cell")
        try:
            server.start()
            made = Machine(server)
            yield made
            made.close()
        finally:
            server.close()


def run(seconds: float, inputs: int, seed: int, *, in_session: bool = True) -> int:
    """Send inputs for a time, or so many; the exit code: 1 where something was found.

    Args:
        in_session: also messages of an open session, changed on their way.
    """
    with machine() as watched:
        sent = Inputs(watched.address, seed, in_session=in_session)
        return judged("port", watched, sent, watched.look, seconds, inputs, seed)


def judged(
    name: str,
    watched: Machine,
    sent: Inputs,
    look: Callable[[], str],
    seconds: float,
    inputs: int,
    seed: int,
) -> int:
    """Send inputs and look between them; the exit code: 1 where something was found."""
    wrong = look()
    until = time.monotonic() + seconds
    number = 0
    while not wrong and (number < inputs if inputs else time.monotonic() < until):
        sent.send(number)
        number += 1
        if number % LOOK_EVERY == 0:
            wrong = look()
    sent.close()
    wrong = wrong or look()
    told = watched.told()
    for kind, count in sent.counts.items():
        print(f"{count:10} inputs: {name}, {kind.strip('_')}")
    print(told)
    print(f"{number:10} in all, seed {seed}: {wrong or 'the server answers, the program ran'}", flush=True)
    return 1 if wrong else 0
