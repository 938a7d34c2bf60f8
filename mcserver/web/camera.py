"""The picture of a machine's camera, fetched by the page from the one address that its machine file has."""

from __future__ import annotations

import asyncio

import httpx
from mcclient import MotionError

MAX_BYTES = 4 << 20
LIMIT_S = 5.0


async def fetch_picture(address: str, transport: httpx.AsyncBaseTransport | None = None) -> tuple[str, bytes]:
    """Return the media type of a still picture, and its bytes.

    Args:
        transport: for tests.

    Raises:
        MotionError: MC055 there is no camera, or what it answers is no picture of at most `MAX_BYTES`;
            redirects are not followed.
    """
    if not address:
        raise MotionError("MC055", "the machine file names no camera", "give [machine] camera")
    content = bytearray()
    try:
        async with (
            asyncio.timeout(LIMIT_S),
            httpx.AsyncClient(follow_redirects=False, transport=transport, trust_env=False) as client,
            client.stream("GET", address) as answer,
        ):
            kind = answer.headers.get("content-type", "").partition(";")[0].strip().lower()
            # an SVG may have scripts
            if answer.status_code != 200 or kind not in ("image/jpeg", "image/png", "image/webp"):
                raise _refusal(f"it answers {answer.status_code} {kind}")
            async for piece in answer.aiter_bytes():
                content += piece
                if len(content) > MAX_BYTES:
                    raise _refusal(f"its picture has more than {MAX_BYTES >> 20} MiB")
    except (httpx.HTTPError, httpx.InvalidURL, TimeoutError, ValueError) as error:
        raise _refusal(type(error).__name__) from error
    return kind, bytes(content)


def _refusal(what: str) -> MotionError:
    return MotionError("MC055", f"the camera gives no picture: {what}", "look at [machine] camera")
