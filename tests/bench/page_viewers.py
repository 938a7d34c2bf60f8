"""Viewers of the operator's page without a browser: ``python -m tests.bench.page_viewers URL COUNT``.

Each loads the page and holds its WebSocket as a browser does, takes what comes, acknowledges it, confirms
signs of life, and says that its pictures are there. Prints a line when all are connected, runs until its
input ends, and prints what came as JSON.
"""

from __future__ import annotations

import asyncio
import json
import re
import sys
import time
import uuid
from typing import Any
from urllib.parse import urlencode

import httpx
import socketio

SOCKET = "_nicegui_ws/socket.io"
_CLIENT = re.compile(r"'client_id': '([0-9a-f-]+)'")
_SPACE = re.compile(r'"(\d+)":\{"tag":"nicegui-space".*?"events":\[(.*?)\]\}')
_ALIVE = re.compile(r"mcAlive\((\d+)\)")
_READY = re.compile(r'"listener_id":"([0-9a-f-]+)","type":"ready"')


class Viewer:
    """One browser's part of the protocol."""

    def __init__(self) -> None:
        self.messages = 0
        self._next = 0
        self._socket = socketio.AsyncClient(reconnection=False)
        self._socket.on("*", self._on_message)

    async def open(self, http: httpx.AsyncClient, url: str) -> None:
        text = (await http.get(url)).text
        found = _CLIENT.search(text)
        assert found is not None, text[:500]
        self._client = found[1]
        query = {
            "client_id": self._client,
            "next_message_id": 0,
            "implicit_handshake": "true",
            "document_id": str(uuid.uuid4()),
            "tab_id": str(uuid.uuid4()),
            "old_tab_id": "null",
        }
        root = str(httpx.URL(url).join("/"))
        await self._socket.connect(
            f"{root}?{urlencode(query)}", socketio_path=SOCKET, transports=["websocket"], wait_timeout=60
        )
        for element, listeners in _SPACE.findall(text):
            for listener in _READY.findall(listeners):
                message = {"id": int(element), "client_id": self._client, "listener_id": listener, "args": []}
                await self._socket.emit("event", message)

    async def acknowledge(self) -> None:
        if self._socket.connected:
            await self._socket.emit("ack", {"client_id": self._client, "next_message_id": self._next})

    async def close(self) -> None:
        await self._socket.disconnect()

    async def _on_message(self, _event: str, *data: Any) -> None:
        self.messages += 1
        if not data or not isinstance(data[0], dict):
            return
        if "_id" in data[0]:
            self._next = int(data[0]["_id"]) + 1
        sign = _ALIVE.search(data[0].get("code", ""))
        if sign is not None:
            # a browser that does not confirm it is sent nothing more to draw
            told = {"client_id": self._client, "sent_s": time.time(), "sign": int(sign[1])}
            await self._socket.emit("clock", told)


async def run(url: str, count: int) -> None:
    """Hold ``count`` viewers until standard input ends."""
    viewers = [Viewer() for _ in range(count)]
    async with httpx.AsyncClient(timeout=120.0) as http:
        for viewer in viewers:
            await viewer.open(http, url)
        print("connected", flush=True)
        started, before = time.perf_counter(), sum(viewer.messages for viewer in viewers)
        ending = asyncio.get_running_loop().run_in_executor(None, sys.stdin.read)
        while not ending.done():
            await asyncio.sleep(1.0)
            await asyncio.gather(*(viewer.acknowledge() for viewer in viewers))
        came = sum(viewer.messages for viewer in viewers) - before
        print(json.dumps({"messages_a_second": came / count / (time.perf_counter() - started)}), flush=True)
        await asyncio.gather(*(viewer.close() for viewer in viewers))


if __name__ == "__main__":
    asyncio.run(run(sys.argv[1], int(sys.argv[2])))
