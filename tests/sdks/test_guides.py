"""The examples of the SDKs' pages run as they are printed, against a real server through the gateway."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.e2e.servers import ROOT
from tests.gateway.conftest import GatewayProcess
from tests.sdks.built import build
from tests.sdks.conftest import environment, go_tool, typescript

GO = re.findall(r"```go\n(package main\n.*?)```", (ROOT / "docs" / "go.md").read_text("utf-8"), re.DOTALL)
TYPESCRIPT = re.findall(r"```ts\n(.*?)```", (ROOT / "docs" / "typescript.md").read_text("utf-8"), re.DOTALL)


@pytest.fixture(scope="session")
def go_examples(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A module with each example as a command of its own, built."""
    go, folder, sdk = go_tool(), tmp_path_factory.mktemp("go"), ROOT / "clients" / "go"
    module = (sdk / "go.mod").read_text("utf-8").replace("module mcserver.example/mcclient", "module guide")
    module += f"\nrequire mcserver.example/mcclient v0.0.0\nreplace mcserver.example/mcclient => {sdk}\n"
    (folder / "go.mod").write_text(module, "utf-8")
    shutil.copy(sdk / "go.sum", folder)
    for number, text in enumerate(GO):
        (folder / f"example{number}").mkdir()
        (folder / f"example{number}" / "main.go").write_text(text, "utf-8")
    (folder / "bin").mkdir()
    build([go, "vet", "-mod=mod", "./..."], folder)
    build([go, "build", "-mod=mod", "-o", "bin/", "./..."], folder)
    return folder / "bin"


@pytest.mark.usefixtures("machine")
@pytest.mark.parametrize("number", range(len(GO)))
def test_an_example_of_the_go_guide_runs(
    go_examples: Path, number: int, gateway: GatewayProcess, tokens: tuple[Path, dict[str, str]]
) -> None:
    done = subprocess.run(
        [str(go_examples / f"example{number}")],
        env={**environment(), "MC_GATEWAY": gateway.ws, "MC_TOKEN": tokens[1]["operator"]},
        capture_output=True,
        text=True,
        timeout=30,
        check=False,
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.usefixtures("machine")
@pytest.mark.parametrize("example", TYPESCRIPT, ids=["first", "targets"])
def test_an_example_of_the_typescript_guide_runs(
    example: str, gateway: GatewayProcess, tokens: tuple[Path, dict[str, str]]
) -> None:
    node = typescript().command[0]
    # within the package, which is found there by its name
    file = ROOT / "clients" / "typescript" / "dist" / "guide.mjs"
    file.write_text(example, "utf-8")
    done = subprocess.run(
        [node, str(file)],
        env={**environment(), "MC_GATEWAY": gateway.ws, "MC_TOKEN": tokens[1]["operator"]},
        capture_output=True,
        text=True,
        timeout=30,
        check=False,
    )
    said = "done through line 3\n" if "program" in example else ""
    assert (done.returncode, done.stdout, done.stderr) == (0, said, "")


def test_a_guide_has_examples() -> None:
    assert len(GO) >= 6
    assert len(TYPESCRIPT) == 2
