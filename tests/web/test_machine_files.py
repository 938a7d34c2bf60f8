"""Models and recordings that the page takes over from a server."""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any, cast

import msgspec
import pytest
from mcclient import Info, Machine, MotionError
from mcclient.types import ModelReply, RecordingInfo, RecordingsReply, ToolInfo

from mcserver.machine.machine_file import load_machine
from mcserver.net.model_methods import look
from mcserver.web.recorded_files import KEPT, RecordedFiles
from mcserver.web.robot_model import fetch_model
from tests.wire_values import wire_value


class Server:
    """Answers as a machine does."""

    def __init__(self, model: dict[str, Any], tools: tuple[ToolInfo, ...] = ()) -> None:
        self.answer = model
        self.asked = 0
        self.sizes = {"one": 3}
        self.info = wire_value(Info, "m", "0", (1,), "i", 0.0, 1e-3, tools=tools)

    async def model(self) -> ModelReply:
        self.asked += 1
        return msgspec.convert(self.answer, ModelReply)

    async def read_mesh(self, mesh: int) -> bytes:
        raise AssertionError(mesh)

    async def recordings(self) -> RecordingsReply:
        found = tuple(wire_value(RecordingInfo, name=name, size=size) for name, size in self.sizes.items())
        return wire_value(RecordingsReply, found, None)

    async def read_recording(self, name: str) -> AsyncIterator[tuple[bytes, int]]:
        assert name in self.sizes
        yield b"abc", 3


def model_of(name: str) -> tuple[dict[str, Any], tuple[ToolInfo, ...]]:
    machine = load_machine(name)
    tools = tuple(wire_value(ToolInfo, tool.number, tool.frame, tuple(tool.axes)) for tool in machine.tools)
    return cast("dict[str, Any]", msgspec.to_builtins(look(machine)[0])), tools


def fetched(server: Server, folder: Path) -> dict[str, Any]:
    content = asyncio.run(fetch_model(cast("Machine", server), folder))
    return cast("dict[str, Any]", json.loads(content))


def test_a_robot_dog_stands_on_its_feet_and_each_axis_drives_one_joint(tmp_path: Path) -> None:
    model = fetched(Server(*model_of("robot-dog")), tmp_path)
    assert math.hypot(*model["up"]) == pytest.approx(1.0)
    drivers = [part["driver"] for part in model["parts"] if part["driver"] is not None]
    assert sorted(drivers) == list(range(12))
    known: set[str] = set()
    for part in model["parts"]:
        # a browser hangs each part on one that is there
        assert part["parent"] is None or part["parent"] in known
        known.add(part["name"])
    assert any(part["solids"] for part in model["parts"])


def test_a_model_is_kept_until_its_files_change(tmp_path: Path) -> None:
    answer, tools = model_of("arm6")
    server = Server(answer, tools)
    first = fetched(server, tmp_path)
    (kept,) = tmp_path.glob("*.json")
    kept.write_text('{"parts": "kept"}')
    assert fetched(server, tmp_path) == {"parts": "kept"}
    server.answer = {**answer, "digest": "other"}
    assert fetched(server, tmp_path) == first
    assert [path.stem.partition("-")[0] for path in tmp_path.glob("*.json")] == ["other"]


@pytest.mark.parametrize("digest", ["../outside", "a/b", "ü", "."])
def test_a_digest_never_leads_out_of_the_folder(tmp_path: Path, digest: str) -> None:
    server = Server({"urdf": "", "digest": digest, "joints": {}, "meshes": []})
    with pytest.raises(MotionError) as refused:
        fetched(server, tmp_path / "models")
    assert refused.value.code == "MC587"
    assert not list(tmp_path.rglob("*.json"))


@pytest.mark.parametrize("urdf", ["<robot", "<robot/>", "no xml"])
def test_a_urdf_that_cannot_be_drawn_is_an_error_with_a_code(tmp_path: Path, urdf: str) -> None:
    server = Server({"urdf": urdf, "digest": "d1", "joints": {}, "meshes": []})
    with pytest.raises(MotionError) as refused:
        fetched(server, tmp_path)
    assert refused.value.code == "MC587"


@pytest.mark.parametrize(("name", "code"), [("../one", "MC585"), ("gone", "MC585"), ("one", "MC588")])
def test_what_cannot_be_played_has_a_code_and_leaves_nothing_outside(
    tmp_path: Path, name: str, code: str
) -> None:
    files = RecordedFiles(tmp_path / "kept")
    server = Server({})
    server.sizes["../one"] = 3
    with pytest.raises(MotionError) as refused:
        asyncio.run(files.replay(cast("Machine", server), name))
    assert refused.value.code == code
    assert [path.name for path in tmp_path.iterdir()] in ([], ["kept"])


def test_only_the_newest_recordings_are_kept_here(tmp_path: Path) -> None:
    files = RecordedFiles(tmp_path)
    server = Server({})
    for number in range(KEPT + 3):
        (tmp_path / f"old-{number}.1").mkdir()
    with pytest.raises(MotionError):
        asyncio.run(files.replay(cast("Machine", server), "one"))
    assert len(list(tmp_path.iterdir())) == KEPT
