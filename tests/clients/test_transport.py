"""Queries of one server."""

from __future__ import annotations

import asyncio
import threading

import zenoh
from mcclient.transport import Link

from tests.zenoh_sessions import locator_of, opened

LIMIT_S = 30.0


async def test_a_call_returns_with_its_reply_though_the_query_is_still_open() -> None:
    kept: list[zenoh.Query] = []
    answered = threading.Event()

    def on_query(query: zenoh.Query) -> None:
        kept.append(query)
        query.reply(query.key_expr, b"answer")
        answered.set()

    with opened({"adminspace/enabled": True, "listen/endpoints": ["tcp/127.0.0.1:0"]}) as server:
        queryable = server.declare_queryable("k", zenoh.handlers.Callback(on_query, indirect=False))
        link = await Link.open((locator_of(server),), timeout_s=LIMIT_S)
        async with asyncio.timeout(LIMIT_S):
            replies: list[bytes] = []
            while not replies:
                # it may not know of the queryable yet
                replies = [r.payload for r in await link.query("k", b"", timeout_s=10 * LIMIT_S, one=True)]
        assert replies == [b"answer"]
        assert len(kept) == 1
        # the reply may be there before the query's own call has returned
        assert await asyncio.to_thread(answered.wait, LIMIT_S)
        for query in kept:
            query.drop()
        await link.close()
        queryable.undeclare()  # type: ignore[no-untyped-call]
