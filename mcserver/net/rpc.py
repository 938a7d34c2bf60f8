"""Remote calls: one queryable, a table of methods, and one place where errors become replies."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Awaitable, Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import msgspec
import zenoh

from mcserver.errors import McError, ProgramRejected, Refused, ServiceError
from mcserver.net.answers import Answer, AnswerMemory
from mcserver.net.decoding import MessageDecoder
from mcserver.net.defects import DefectLog
from mcserver.net.keys import Call, Keys
from mcserver.net.messages import ENCODING, ErrorReply, Request
from mcserver.net.method_table import BY_NAME, Method
from mcserver.net.replies import Outgoing, ReplySender
from mcserver.net.session import is_zenoh_fault
from mcserver.service.reports import wire_diagnostic

log = logging.getLogger(__name__)

IN_FLIGHT = 512
INFO_LANES = 4
_RPC_CHUNK = "/@rpc/"

# Takes the client's id and a method's request; returns the reply's message, or an awaitable of it; raises
# `McError`.
Handler = Callable[[str, Any], Any]


class KeyedQuery(NamedTuple):
    """A query and the meaning of its key.

    Attributes:
        key: as requested. reply_key: of its answer. lane: queue in which its replies wait.
        call: None if the key does not name one client and one method. method: None for an unknown name.
    """

    query: zenoh.Query
    key: str
    reply_key: str
    lane: str
    call: Call | None
    method: Method | None


def encode_error(error: BaseException) -> bytes:
    """Return the payload of ``reply_err`` for any exception; unexpected ones become MC516."""
    if isinstance(error, ProgramRejected):
        reply = ErrorReply(
            code=error.code,
            message=error.message,
            hint=error.hint,
            details=getattr(error, "details", {}),
            diagnostics=[wire_diagnostic(diagnostic) for diagnostic in error.diagnostics],
        )
    elif isinstance(error, McError):
        reply = ErrorReply(
            code=error.code, message=error.message, hint=error.hint, details=getattr(error, "details", {})
        )
    else:
        reply = ErrorReply(
            code="MC516",
            message=f"the server made a mistake: {type(error).__name__}: {error}",
            hint="this is a defect of the server; its log has the traceback",
        )
    return msgspec.msgpack.encode(reply)


class RpcServer:
    """Answers queries on ``@rpc/{client}/{method}`` and ``info``.

    Args:
        handlers: by name of the method; ``info`` has its own key.
    """

    def __init__(self, keys: Keys, handlers: Mapping[str, Handler], replies: ReplySender) -> None:
        self._keys = keys
        self._handlers = handlers
        self._encode = msgspec.msgpack.Encoder().encode
        self._decoders = {name: MessageDecoder(BY_NAME[name].request) for name in handlers}
        # on a key of its own, without a client id
        self._info = Call("", "info", exact=False)
        self._answers = AnswerMemory(time.monotonic)
        self._replies = replies
        self._info_lane = 0
        self._defects = DefectLog(log)
        self._tasks: set[asyncio.Task[None]] = set()

    def on_query(self, query: zenoh.Query) -> None:
        """Execute one query, in the loop; it is dropped once it is answered."""
        asked = self._asked(query)
        if not self._replies.has_room(asked.lane):
            # the caller accepts no replies now: do no work for it; it may ask again
            self.refuse(query)
            return
        try:
            call, method = self._callable(asked)
            self._carry_out(asked, call, method)
        except Exception as error:
            self._send(asked, self._failed(asked.key, error))

    def refuse(self, query: zenoh.Query) -> None:
        """Drop a query without an answer; from any thread."""
        self._replies.discard(query.drop)

    async def close(self) -> None:
        """Cancel requests in progress."""
        for task in list(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def _asked(self, query: zenoh.Query) -> KeyedQuery:
        key = str(query.key_expr)
        call = self._info if _RPC_CHUNK not in key else self._keys.call_of(key)
        if call is None or call is self._info:
            # the caller is unknown: spread over several lanes, so that a stuck one does not block all
            self._info_lane = (self._info_lane + 1) % INFO_LANES
            lane, reply_key = f"info/{self._info_lane}", self._keys.info
        else:
            lane, reply_key = call.client, self._keys.rpc(call.client, call.method)
        method = None if call is None or call.method not in self._handlers else BY_NAME[call.method]
        return KeyedQuery(query, key, reply_key, lane, call, method)

    def _callable(self, asked: KeyedQuery) -> tuple[Call, Method]:
        """Return the call of a query and its method.

        Raises:
            ServiceError: MC501, MC502.
        """
        call, method = asked.call, asked.method
        if call is None:
            raise Refused(
                "MC502",
                f"{asked.key!r} names no single client and method; they are letters, digits, '-', '_', '.'",
                f"ask {self._keys.rpc('{client}', '{method}')} with both written out",
                key=asked.key,
            )
        if method is None:
            raise Refused(
                "MC501",
                f"there is no method {call.method!r}",
                "see `methods`",
                methods=sorted(self._handlers),
            )
        if method.changes and not call.exact:
            raise Refused(
                "MC502",
                f"{asked.key!r} holds a wildcard: that is for methods that change nothing",
                f"ask {asked.reply_key} alone",
                key=asked.key,
            )
        return call, method

    def _carry_out(self, asked: KeyedQuery, call: Call, method: Method) -> None:
        request = self._decode(asked.query, call.method)
        if len(self._tasks) >= IN_FLIGHT:
            raise Refused(
                "MC508", f"{IN_FLIGHT} requests are being worked on", "send it again later", limit=IN_FLIGHT
            )
        number = request.request
        if method.changes:
            if number is None:
                raise ServiceError(
                    "MC506", f"{call.method} needs `request`", "number your requests, each new one anew"
                )
            if not self._answers.begin(call.client, number, call.method, partial(self._send, asked)):
                return
        try:
            reply = self._handlers[method.name](call.client, request)
        except Exception as error:
            self._finish(asked, number, self._failed(asked.key, error))
            return
        if isinstance(reply, msgspec.Struct):
            self._finish(asked, number, Answer(True, self._encode(reply)))
            return
        task = asyncio.ensure_future(self._await(asked, number, reply))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def _finish(self, asked: KeyedQuery, number: int | None, answer: Answer) -> None:
        """Answer a call, and everyone who waits for the same answer."""
        call, method = asked.call, asked.method
        if method is not None and method.changes and call is not None and number is not None:
            self._answers.finish(call.client, number, answer)
        else:
            self._send(asked, answer)

    def _decode(self, query: zenoh.Query, name: str) -> Request:
        payload = query.payload
        # a missing or empty payload is an empty map
        written = (b"" if payload is None else payload.to_bytes()) or b"\x80"
        return self._decoders[name](written)

    async def _await(self, asked: KeyedQuery, number: int | None, reply: Awaitable[object]) -> None:
        try:
            answer = Answer(True, self._encode(await reply))
        except asyncio.CancelledError:
            stopping = ServiceError("MC515", "the server is stopping", "wait for its next start")
            answer = self._failed(asked.key, stopping)
        except Exception as error:
            answer = self._failed(asked.key, error)
        self._finish(asked, number, answer)

    def _failed(self, key: str, error: BaseException) -> Answer:
        if not isinstance(error, McError):
            self._defects.add(f"the call {key} failed: {error}", error)
        return Answer(False, encode_error(error))

    def _send(self, asked: KeyedQuery, answer: Answer) -> None:
        reply = Outgoing(len(answer.payload), partial(_reply, asked, answer), asked.query.drop)
        self._replies.push(asked.lane, reply)


def _reply(asked: KeyedQuery, answer: Answer) -> None:
    query = asked.query
    try:
        with query:
            if answer.ok:
                query.reply(asked.reply_key, answer.payload, encoding=ENCODING)
            else:
                query.reply_err(answer.payload, encoding=ENCODING)
    except BaseException as error:
        if not is_zenoh_fault(error):
            raise
        # the client has disappeared, or its key does not match this reply
        log.info("no answer to %s could be sent: %s", asked.key, error)
