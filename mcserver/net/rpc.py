"""Remote calls: one queryable, a table of methods, one place where errors become replies."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Awaitable, Callable
from typing import Any

import msgspec
import zenoh

from mcserver.errors import McError, ProgramRejected, ServiceError
from mcserver.net.answers import Answer, AnswerMemory
from mcserver.net.decoding import MessageDecoder
from mcserver.net.defects import DefectLog
from mcserver.net.keys import Keys, is_wild
from mcserver.net.messages import ENCODING, ErrorReply, Request
from mcserver.service.deferred import Deferred
from mcserver.service.refusals import Refused
from mcserver.service.reports import wire_diagnostic

log = logging.getLogger(__name__)

IN_FLIGHT = 512
LARGE_REPLY_BYTES = 32 * 1024

Settle = Callable[[object, BaseException | None], None]


class Method(msgspec.Struct, frozen=True):
    """One remote method.

    Attributes:
        request: the message's type, a `Request`.
        call: gives the reply's message, at once, as a `Deferred` or as an awaitable; errors as `McError`.
        changes: whether it changes anything: then it is idempotent by request number, and takes no wildcard.
    """

    request: type[Request]
    call: Callable[[Any], Any]
    changes: bool


def encode_error(error: BaseException) -> bytes:
    """The payload of ``reply_err`` for any exception; what nobody foresaw becomes MC516."""
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
    """Answers queries on ``@rpc/*`` and ``info``. All of it runs in the loop.

    Args:
        keys: of this machine.
        methods: by name; ``info`` is asked for on its own key.
    """

    def __init__(self, keys: Keys, methods: dict[str, Method]) -> None:
        self._keys = keys
        self._methods = methods
        self._encode = msgspec.msgpack.Encoder().encode
        self._decoders = {name: MessageDecoder(method.request) for name, method in methods.items()}
        self._own_keys = {(keys.info if name == "info" else keys.rpc(name)): name for name in methods}
        self._answers = AnswerMemory(time.monotonic)
        self._under_way = 0
        self._defects = DefectLog(log)
        self._tasks: set[asyncio.Task[None]] = set()

    def on_query(self, query: zenoh.Query) -> None:
        """One query; it is dropped once it is answered."""
        key = str(query.key_expr)
        name = self._own_keys.get(key) or key.rpartition("/")[2]
        try:
            self._carry_out(query, name, self._method(key, name))
        except Exception as error:
            self._send(query, name, self._failed(name, error))

    async def close(self) -> None:
        """Cancels what is still being worked on."""
        for task in list(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def _method(self, key: str, name: str) -> Method:
        method = self._methods.get(name)
        exact = key in self._own_keys
        if method is not None and (exact or (is_wild(key) and not method.changes)):
            return method
        if is_wild(key):
            raise Refused(
                "MC502",
                f"{key!r} holds a wildcard: that is for methods that change nothing",
                f"ask {self._keys.rpc('status' if method is None else name)} alone",
                key=key,
            )
        raise Refused("MC501", f"there is no method {name!r}", "see `methods`", methods=sorted(self._methods))

    def _carry_out(self, query: zenoh.Query, name: str, method: Method) -> None:
        request = self._decode(query, name)

        def answer(result: Answer) -> None:
            self._send(query, name, result)

        if self._under_way >= IN_FLIGHT:
            raise Refused(
                "MC508", f"{IN_FLIGHT} requests are being worked on", "send it again later", limit=IN_FLIGHT
            )
        remembered = method.changes
        if remembered:
            if not request.client or request.request is None:
                raise ServiceError(
                    "MC506", f"{name} needs `client` and `request`", "give your id and a new number"
                )
            number = request.request
            if not self._answers.begin(request.client, number, name, answer):
                return
        finish: Callable[[Answer], None] = answer
        if remembered:

            def finish(result: Answer) -> None:
                self._answers.finish(request.client, number, result)

        self._under_way += 1

        def settle(reply: object, error: BaseException | None) -> None:
            self._under_way -= 1
            finish(Answer(True, self._encode(reply)) if error is None else self._failed(name, error))

        try:
            reply = method.call(request)
        except Exception as error:
            settle(None, error)
            return
        if isinstance(reply, Deferred):
            reply.listen(settle)
        elif isinstance(reply, Awaitable):
            task = asyncio.ensure_future(self._await(reply, settle))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)
        else:
            settle(reply, None)

    def _decode(self, query: zenoh.Query, name: str) -> Request:
        payload = query.payload
        # no payload, or an empty one, is an empty map
        written = (b"" if payload is None else payload.to_bytes()) or b"\x80"
        return self._decoders[name](written)

    async def _await(self, reply: Awaitable[object], settle: Settle) -> None:
        try:
            value = await reply
        except asyncio.CancelledError:
            settle(None, ServiceError("MC515", "the server is stopping", "wait for its next start"))
        except Exception as error:
            settle(None, error)
        else:
            settle(value, None)

    def _failed(self, name: str, error: BaseException) -> Answer:
        if not isinstance(error, McError):
            self._defects.add(f"method {name} failed: {error}", error)
        return Answer(False, encode_error(error))

    def _send(self, query: zenoh.Query, name: str, answer: Answer) -> None:
        if len(answer.payload) > LARGE_REPLY_BYTES:
            # a slow link would hold the loop until it has room
            asyncio.get_running_loop().run_in_executor(None, self._reply, query, name, answer)
        else:
            self._reply(query, name, answer)

    def _reply(self, query: zenoh.Query, name: str, answer: Answer) -> None:
        key = self._keys.info if name == "info" else self._keys.rpc(name)
        try:
            with query:
                if answer.ok:
                    query.reply(key, answer.payload, encoding=ENCODING)
                else:
                    query.reply_err(answer.payload, encoding=ENCODING)
        except zenoh.ZError as error:
            # the client went away, or asked by a key that this reply does not match
            log.info("no answer to %s could be sent: %s", name, error)
