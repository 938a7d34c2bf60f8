"""Faults on demand over TCP: one JSON object a line, one answer a line.

``{"node": 3, "fault": "mute"}`` → ``{"ok": true}``; ``{"state": true}`` tells what the nodes do.
"""

from __future__ import annotations

import json
import socket
from collections.abc import Callable, Mapping
from typing import Any

from mcserver.can.address import family_of
from mcserver.drive_sim.fault_injection import BadRequest

MAX_LINE = 4096
MAX_CLIENTS = 16
ANSWER_S = 10.0

Answer = Callable[[Mapping[str, object]], dict[str, object]]


class ControlServer:
    """Serves requests within the loop of `DriveSimulation.run`."""

    def __init__(self, host: str, port: int, answer: Answer) -> None:
        """Listens; port 0 takes a free one.

        Raises:
            OSError: the address cannot be listened on.
        """
        self._answer = answer
        self._listener = socket.create_server((host, port), family=family_of(host))
        self._listener.setblocking(False)
        self._clients: dict[int, tuple[socket.socket, bytearray]] = {}

    @property
    def port(self) -> int:
        port: int = self._listener.getsockname()[1]
        return port

    def descriptors(self) -> list[int]:
        return [self._listener.fileno(), *self._clients]

    def serve(self, ready: set[int]) -> None:
        """Take what has come on the ready descriptors."""
        for descriptor in ready & self._clients.keys():
            self._read(descriptor)
        if self._listener.fileno() in ready:
            self._accept()

    def close(self) -> None:
        """Hang up."""
        for connection, _ in self._clients.values():
            connection.close()
        self._clients.clear()
        self._listener.close()

    def _accept(self) -> None:
        try:
            connection, _ = self._listener.accept()
        except OSError:
            return
        if len(self._clients) >= MAX_CLIENTS:
            connection.close()
            return
        connection.setblocking(False)
        self._clients[connection.fileno()] = (connection, bytearray())

    def _read(self, descriptor: int) -> None:
        connection, text = self._clients[descriptor]
        try:
            received = connection.recv(MAX_LINE)
        except BlockingIOError:
            return
        except OSError:
            received = b""
        text += received
        *lines, rest = bytes(text).split(b"\n")
        text[:] = rest
        try:
            for line in lines:
                connection.sendall(json.dumps(self._obey(line)).encode() + b"\n")
        except OSError:
            received = b""
        if not received or len(text) > MAX_LINE:
            del self._clients[descriptor]
            connection.close()

    def _obey(self, line: bytes) -> dict[str, object]:
        try:
            request = json.loads(line)
            if not isinstance(request, dict):
                raise BadRequest("a request is a JSON object")
            return self._answer(request)
        except (ValueError, RecursionError) as error:
            return {"ok": False, "error": f"no JSON: {error}"}
        except BadRequest as error:
            return {"ok": False, "error": str(error)}


class Control:
    """A client of the control port; waits for each answer."""

    def __init__(self, host: str, port: int) -> None:
        """Connect.

        Raises:
            OSError: nobody listens there.
        """
        self._socket = socket.create_connection((host, port), timeout=ANSWER_S)
        self._reader = self._socket.makefile("rb")

    def __enter__(self) -> Control:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Hang up; the faults stay."""
        self._reader.close()
        self._socket.close()

    def fault(self, node: int, fault: str, **values: object) -> None:
        """Ask for a fault on demand, such as ``fault(3, "late_tpdo", syncs=2)``.

        Raises:
            BadRequest: it was refused. OSError: the simulation is gone.
        """
        self._request({"node": node, "fault": fault, **values})

    def clear(self, node: int | None = None) -> None:
        """End all faults of a node, or of every node. Raises: as `fault`."""
        self._request({"fault": "clear"} | ({} if node is None else {"node": node}))

    def states(self) -> list[dict[str, Any]]:
        """Return what every node does. Raises: as `fault`."""
        nodes: list[dict[str, Any]] = self._request({"state": True})["nodes"]
        return nodes

    def state(self, node: int, bus: str | None = None) -> dict[str, Any]:
        """Return what one node does. Raises: as `fault`."""
        request = {"state": True, "node": node} | ({} if bus is None else {"bus": bus})
        found: dict[str, Any] = self._request(request)["nodes"][0]
        return found

    def _request(self, request: Mapping[str, object]) -> dict[str, Any]:
        self._socket.sendall(json.dumps(request).encode() + b"\n")
        line = self._reader.readline()
        if not line:
            raise ConnectionError("the simulation has hung up")
        answer: dict[str, Any] = json.loads(line)
        if not answer.get("ok"):
            raise BadRequest(str(answer.get("error")))
        return answer
