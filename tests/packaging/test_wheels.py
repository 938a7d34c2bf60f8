"""The wheels, built and installed into an empty environment in another folder, do what the sources do."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import venv
import zipfile
from collections.abc import Iterator
from email.parser import Parser
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PROJECTS = (
    ROOT,
    *(
        ROOT / each
        for each in ("clients/python", "clients/benchmark", "clients/gym", "clients/lerobot", "kinematics")
    ),
)
START_LIMIT_S = 120.0

pytestmark = pytest.mark.timeout(600)


@pytest.fixture(scope="module")
def wheels(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The wheels by name, built from the sources as pip does."""
    folder = tmp_path_factory.mktemp("wheels")
    for project in PROJECTS:
        build = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-index"]
        run([*build, "--no-build-isolation", "--wheel-dir", str(folder), str(project)], folder)
    return {file.name.split("-")[0]: file for file in folder.glob("*.whl")}


@pytest.fixture(scope="module")
def installed(wheels: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The commands of an environment that has the wheels and, from here, what they depend on."""
    folder = tmp_path_factory.mktemp("elsewhere")
    venv.create(folder / "env", with_pip=False)
    python = folder / "env" / "bin" / "python"
    own = [str(wheels["mcserver"]), str(wheels["mcclient"])]
    pip = [
        sys.executable,
        "-m",
        "pip",
        "--python",
        str(python),
        "install",
        "--quiet",
        "--no-deps",
        "--no-index",
    ]
    run([*pip, *own], folder)
    there = run([str(python), "-c", "import sysconfig; print(sysconfig.get_paths()['purelib'])"], folder)
    # plain paths: the files .pth in them, as of editable installations, are not read
    paths = [path for path in sys.path if path.endswith("site-packages")]
    Path(there.strip(), "dependencies.pth").write_text("".join(f"{path}\n" for path in paths))
    return folder / "env" / "bin"


def run(command: list[str], folder: Path) -> str:
    """Run a command in a folder, with nothing of these sources in its environment; return what it prints."""
    done = subprocess.run(
        command, cwd=folder, env=environment(), capture_output=True, text=True, timeout=400, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def environment() -> dict[str, str]:
    return {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}


def test_the_package_is_the_installed_one(installed: Path, tmp_path: Path) -> None:
    shown = run([str(installed / "python"), "-c", "import mcserver; print(mcserver.__file__)"], tmp_path)
    assert Path(shown.strip()).is_relative_to(installed.parent)


def test_the_gait_is_simulated(installed: Path, tmp_path: Path) -> None:
    run([str(installed / "mcserver"), "examples", "robot-dog", "--output", "."], tmp_path)
    command = [str(installed / "mcserver"), "simulate", "robot-dog.gcode", "--machine", "robot-dog", "--json"]
    answer = json.loads(run(command, tmp_path))
    assert answer["ok"] is True
    assert len(answer["lines"]) == 8
    assert all(each["stretched_by"] == pytest.approx(1.0) for each in answer["lines"])


@pytest.fixture
def endpoint(installed: Path, tmp_path: Path) -> Iterator[str]:
    """Where a server of the built-in Cartesian machine answers."""
    options = ["--machine", "cartesian", "--listen", "tcp/127.0.0.1:0", "--journal", "journal.db"]
    server = subprocess.Popen(
        [str(installed / "mcserver"), "run", *options],
        cwd=tmp_path,
        env=environment(),
        stderr=subprocess.PIPE,
        text=True,
    )
    assert server.stderr is not None
    try:
        said = ""
        for line in server.stderr:
            said += line
            found = re.search(r"tcp/127\.0\.0\.1:\d+", line)
            if found:
                yield found[0]
                break
        else:
            raise AssertionError(said)
    finally:
        server.send_signal(signal.SIGTERM)
        server.communicate(timeout=60)


def test_an_example_runs_on_a_server(installed: Path, endpoint: str, tmp_path: Path) -> None:
    run([str(installed / "mcserver"), "examples", "square", "--output", "."], tmp_path)
    run([str(installed / "mcctl"), "run", "--connect", endpoint, "square.gcode"], tmp_path)


def test_they_have_types_a_licence_and_the_examples(wheels: dict[str, Path]) -> None:
    for name, package in (
        ("mcserver", "mcserver"),
        ("mcclient", "mcclient"),
        ("mckinematics", "mckinematics"),
        ("mcbenchmark", "mcbenchmark"),
        ("mcclient_gym", "mcclient_gym"),
        ("lerobot_robot_mcserver", "lerobot_robot_mcserver"),
    ):
        names = zipfile.ZipFile(wheels[name]).namelist()
        assert f"{package}/py.typed" in names
        assert any(each.endswith("licenses/LICENSE") for each in names)
    names = zipfile.ZipFile(wheels["mcserver"]).namelist()
    assert {f"mcserver/examples/{file.name}" for file in (ROOT / "examples").glob("*.gcode")} <= set(names)
    assert "mckinematics/models/robot-dog.urdf" in names
    assert not [each for each in names if "benchmark" in each]
    assert "mcbenchmark/tasks/01-lines.toml" in zipfile.ZipFile(wheels["mcbenchmark"]).namelist()
    assert "mckinematics/py.typed" in names


def test_the_readme_of_the_index_has_no_dead_links(wheels: dict[str, Path]) -> None:
    archive = zipfile.ZipFile(wheels["mcserver"])
    (metadata,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
    text = Parser().parsestr(archive.read(metadata).decode("utf-8")).get_payload()
    assert isinstance(text, str)
    assert "What it does" in text
    assert "![" not in text
    assert re.findall(r"\]\((?!https?:)", text) == []
