"""The files of deploy/: they parse, name commands and files that exist, and give no rights away."""

from __future__ import annotations

import configparser
import json
import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import typer
import yaml

from mcserver.cli.app import build_app
from mcserver.security.site import Site
from mcserver.security.site_files import ROUTER, SITE_FILE, configuration_path

DEPLOY = Path(__file__).parents[2] / "deploy"
CONTAINER = DEPLOY / "container"
DOCKERFILES = sorted(CONTAINER.glob("*.Dockerfile"))
UNITS = sorted((DEPLOY / "systemd").glob("*.service"))
INSTRUCTIONS = {
    "FROM",
    "WORKDIR",
    "COPY",
    "RUN",
    "USER",
    "ENV",
    "VOLUME",
    "EXPOSE",
    "STOPSIGNAL",
    "ENTRYPOINT",
    "CMD",
}


def instructions(file: Path) -> list[tuple[str, str]]:
    """Instruction and arguments, lines that go on put together."""
    text = re.sub(r"(?m)^#.*\n", "", file.read_text("utf-8")).replace("\\\n", " ")
    return [tuple(line.split(None, 1)) for line in text.splitlines() if line.strip()]  # type: ignore[misc]


def assert_command(words: list[str]) -> None:
    """Fail unless ``mcserver`` has that command with those options."""
    assert Path(words[0]).name == "mcserver"
    command = typer.main.get_command(build_app())
    rest = words[1:]
    while hasattr(command, "commands"):
        command = command.commands[rest.pop(0)]
    known = {option for each in command.params for option in (*each.opts, *each.secondary_opts)}
    assert {word for word in rest if word.startswith("-")} <= known


@pytest.mark.parametrize("file", DOCKERFILES, ids=lambda file: file.name)
def test_an_image_is_made_of_known_instructions_and_runs_a_command_that_exists(file: Path) -> None:
    found = instructions(file)
    assert {name for name, _ in found} <= INSTRUCTIONS
    assert found[0][0] == "FROM"
    last = dict(found)
    assert_command([*json.loads(last["ENTRYPOINT"]), *json.loads(last["CMD"])])
    # the last user is no administrator, and the program gets the signal itself
    assert last["USER"] not in ("root", "0")
    assert last["STOPSIGNAL"] == "SIGTERM"


@pytest.mark.parametrize("file", DOCKERFILES, ids=lambda file: file.name)
def test_what_an_image_copies_is_there(file: Path) -> None:
    stages = re.findall(r"(?m)^FROM \S+ AS (\S+)", file.read_text("utf-8"))
    for name, arguments in instructions(file):
        if name == "COPY":
            words = arguments.split()
            assert words[0] == f"--from={stages[0]}" or words == [".", "."]


@pytest.fixture(scope="module")
def composed() -> dict[str, Any]:
    answer: dict[str, Any] = yaml.safe_load((CONTAINER / "compose.yaml").read_text("utf-8"))
    return answer


def test_the_composition_names_files_that_are_there_or_that_the_site_makes(composed: dict[str, Any]) -> None:
    site = Site(router="192.168.1.10", machines=("cell-1",), users=())
    made = {configuration_path(Path("site"), each).name for each in (*site.identities(), ROUTER)}
    made |= {SITE_FILE}
    for service in composed["services"].values():
        assert (CONTAINER / service["build"]["context"] / service["build"]["dockerfile"]).is_file()
        for volume in service["volumes"]:
            source = volume.split(":")[0]
            if source.startswith("./site/"):
                assert Path(source).name in made
                assert volume.endswith(":ro")
            else:
                assert source == "./machine.toml" or source in composed["volumes"]


def test_no_container_has_the_authority_s_key_or_more_rights_than_it_needs(composed: dict[str, Any]) -> None:
    assert "authority" not in json.dumps(composed)
    for service in composed["services"].values():
        assert service["cap_drop"] == ["ALL"]
        assert set(service.get("cap_add", ())) <= {"SYS_NICE", "IPC_LOCK"}
        assert service["read_only"] is True
        assert not service.get("privileged", False)


def test_a_faulty_machine_is_not_started_for_ever(composed: dict[str, Any]) -> None:
    assert composed["services"]["cell-1"]["restart"].startswith("on-failure:")


@pytest.mark.parametrize("file", UNITS, ids=lambda file: file.name)
def test_a_unit_runs_a_command_that_exists_as_its_own_user(file: Path) -> None:
    unit = configparser.ConfigParser(strict=False, interpolation=None)
    unit.optionxform = str  # type: ignore[assignment,method-assign]
    unit.read_string(file.read_text("utf-8").replace("\\\n", " "))
    assert_command(shlex.split(unit["Service"]["ExecStart"]))
    assert unit["Service"]["User"] not in ("root", "")
    assert unit["Service"]["NoNewPrivileges"] == "yes"
    assert unit["Install"]["WantedBy"] == "multi-user.target"
