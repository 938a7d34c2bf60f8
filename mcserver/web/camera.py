"""The picture of a machine's camera, fetched by the page from the one address that its machine file has."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from functools import partial
from types import MappingProxyType

import httpx
from mcclient import MotionError

from mcserver.web.link import MachineLink
from mcserver.web.translation import mark

MAX_BYTES = 4 << 20
LIMIT_S = 5.0
# However many look, the camera is asked once in so long [s].
PERIOD_S = 0.9
# What a picture is, its own first bytes say: an SVG, which may have scripts, is none of these.
KINDS: Mapping[bytes, str] = MappingProxyType(
    {b"\xff\xd8\xff": "image/jpeg", b"\x89PNG\r\n\x1a\n": "image/png", b"RIFF": "image/webp"}
)
# A stream of pictures (MJPEG) is so many parts, each with a head of its own.
STREAM = "multipart/x-mixed-replace"
HEAD_END, PART_END = b"\r\n\r\n", b"\r\n--"


async def camera_picture(link: MachineLink) -> tuple[str, bytes]:
    """Return the media type and the bytes of what a machine's camera sees, at most `PERIOD_S` old.

    Raises:
        MotionError: MC530 the machine is not connected; MC055 as `fetch_picture`.
    """
    ask = partial(fetch_picture, link.connected().info.camera)
    return await link.answers.get("camera", PERIOD_S, ask)


async def fetch_picture(address: str, transport: httpx.AsyncBaseTransport | None = None) -> tuple[str, bytes]:
    """Return the media type of a still picture, or of the first one of a stream, and its bytes.

    Args:
        transport: for tests.

    Raises:
        MotionError: MC055 there is no camera, or what it answers is no picture of at most `MAX_BYTES`;
            redirects are not followed.
    """
    if not address:
        raise MotionError("MC055", mark("the machine file names no camera"), mark("give [machine] camera"))
    try:
        async with (
            asyncio.timeout(LIMIT_S),
            httpx.AsyncClient(follow_redirects=False, transport=transport, trust_env=False) as client,
            client.stream("GET", address, headers={"Accept-Encoding": "identity"}) as answer,
        ):
            if answer.status_code != 200:
                raise _refusal(mark("it answers {status}", status=answer.status_code))
            # a few packed bytes may become gigabytes
            if answer.headers.get("content-encoding", "identity") != "identity":
                raise _refusal(mark("what it answers is packed"))
            content = await _read(answer)
    except TimeoutError as error:
        raise _refusal(mark("it takes longer than {limit:g} s", limit=LIMIT_S)) from error
    # the last one is of a port beyond 65535
    except (httpx.HTTPError, httpx.InvalidURL, ValueError, ExceptionGroup) as error:
        raise _refusal(type(error).__name__) from error
    kind = next((kind for first, kind in KINDS.items() if content.startswith(first)), None)
    if kind is None:
        said = answer.headers.get("content-type", "")
        raise _refusal(mark("what it answers ({kind}) is no JPEG, PNG or WebP", kind=said[:60]))
    return kind, content


async def _read(answer: httpx.Response) -> bytes:
    """Return all of an answer as it comes, or the first part of a stream, which has no end."""
    stream = answer.headers.get("content-type", "").lower().startswith(STREAM)
    content = bytearray()
    async for piece in answer.aiter_bytes():
        content += piece
        if len(content) > MAX_BYTES:
            raise _refusal(mark("its picture has more than {size} MiB", size=MAX_BYTES >> 20))
        if stream:
            part, end, _ = content.partition(HEAD_END)[2].partition(PART_END)
            if end:
                return bytes(part)
    return bytes(content)


def _refusal(what: str) -> MotionError:
    return MotionError(
        "MC055", mark("the camera gives no picture: {why}", why=what), mark("look at [machine] camera")
    )
