"""The camera's picture: from one address, of bounded size, never another site's page."""

from __future__ import annotations

import gzip
from collections.abc import AsyncIterator

import httpx
import pytest
from mcclient import MotionError

from mcserver.errors import ConfigurationError
from mcserver.machine.machine_file import builtin_text, parse_machine
from mcserver.web.camera import MAX_BYTES, fetch_picture

ADDRESS = "http://camera/still.jpg"
JPEG = {"content-type": "image/jpeg"}
STREAM = {"content-type": "multipart/x-mixed-replace;boundary=cut"}
PICTURE = b"\xff\xd8\xff\xe0 a picture"


async def fetched(*answers: httpx.Response) -> tuple[str, bytes]:
    left = list(answers)
    return await fetch_picture(ADDRESS, httpx.MockTransport(lambda _request: left.pop(0)))


async def test_a_picture_is_passed_on() -> None:
    assert await fetched(httpx.Response(200, headers=JPEG, content=PICTURE)) == ("image/jpeg", PICTURE)


async def test_of_a_stream_the_first_picture_is_taken_and_the_rest_is_left() -> None:
    async def endless() -> AsyncIterator[bytes]:
        while True:
            yield b"--cut\r\nContent-Type: image/jpeg\r\n\r\n" + PICTURE[:9]
            yield PICTURE[9:] + b"\r\n"

    assert await fetched(httpx.Response(200, headers=STREAM, content=endless())) == ("image/jpeg", PICTURE)


@pytest.mark.parametrize(
    "answer",
    [
        httpx.Response(302, headers={"location": "http://169.254.169.254/", **JPEG}),
        httpx.Response(200, headers={"content-type": "text/html"}, content=b"<script>"),
        httpx.Response(200, headers={"content-type": "image/svg+xml"}, content=b"<svg>"),
        httpx.Response(404, headers=JPEG),
        httpx.Response(200, headers=JPEG, content=PICTURE + bytes(MAX_BYTES)),
        httpx.Response(200, headers=JPEG),
        httpx.Response(200, headers=JPEG, content=b"<svg>"),
        httpx.Response(200, headers={**JPEG, "content-encoding": "gzip"}, content=gzip.compress(PICTURE)),
        httpx.Response(200, headers=STREAM, content=b"--cut\r\n" + bytes(MAX_BYTES)),
    ],
)
async def test_what_is_no_picture_is_refused(answer: httpx.Response) -> None:
    with pytest.raises(MotionError, match="gives no picture"):
        await fetched(answer, httpx.Response(200, headers=JPEG, content=b"of another site"))


async def test_a_port_that_there_is_not_is_refused() -> None:
    with pytest.raises(MotionError, match="gives no picture"):
        await fetch_picture("http://127.0.0.1:99999/")


async def test_without_a_camera_nothing_is_asked() -> None:
    with pytest.raises(MotionError, match="names no camera"):
        await fetch_picture("")


def test_a_machine_file_has_group_tags_and_camera_within_bounds() -> None:
    def read(line: str) -> tuple[str, tuple[str, ...], str]:
        machine = parse_machine(builtin_text("cartesian").replace("[machine]", f"[machine]\n{line}", 1))
        return machine.group, machine.tags, machine.camera

    found = read(f'group = "hall-2"\ntags = ["mill", "5-axis"]\ncamera = "{ADDRESS}"')
    assert found == ("hall-2", ("mill", "5-axis"), ADDRESS)
    for wrong in ('camera = "file:///etc/passwd"', 'camera = "http://ada:secret@camera/"', 'tags = ["a b"]'):
        with pytest.raises(ConfigurationError):
            read(wrong)
