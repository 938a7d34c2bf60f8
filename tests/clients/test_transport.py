"""Queries of one server."""

from __future__ import annotations

import asyncio
import json
import threading

import zenoh
from mcclient.transport import Link

LIMIT_S = 30.0


async def test_a_call_returns_with_its_reply_though_the_query_is_still_open() -> None:
    config = zenoh.Config()
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("adminspace/enabled", "true")
    config.insert_json5("listen/endpoints", '["tcp/127.0.0.1:0"]')
    kept: list[zenoh.Query] = []
    answered = threading.Event()

    def on_query(query: zenoh.Query) -> None:
        kept.append(query)
        query.reply(query.key_expr, b"answer")
        answered.set()

    with zenoh.open(config) as server:
        queryable = server.declare_queryable("k", zenoh.handlers.Callback(on_query, indirect=False))
        (admin,) = server.get(f"@/{server.zid()}/*")
        assert admin.ok is not None
        link = await Link.open((json.loads(admin.ok.payload.to_bytes())["locators"][0],), timeout_s=LIMIT_S)
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
