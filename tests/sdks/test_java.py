"""The Java SDK: its own tests, the contract among them; the examples of its page against a real gateway."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from tests.e2e.servers import ROOT
from tests.gateway.conftest import GatewayProcess
from tests.sdks.conftest import environment, needed
from tests.sdks.maven import FOLDER, java, maven

LIMIT_S = 60.0
# the first one fetches Maven's plugins too
pytestmark = pytest.mark.timeout(1000)


@pytest.fixture(scope="module", autouse=True)
def built() -> None:
    needed("mvn")
    needed("java")
    maven("test")


def test_it_plays_the_contract() -> None:
    (report,) = (FOLDER / "target" / "surefire-reports").glob("*ContractTest.txt")
    found = re.search(r"Tests run: (\d+), Failures: 0, Errors: 0, Skipped: 0", report.read_text("utf-8"))
    assert found is not None
    assert int(found[1]) > 20


def test_every_example_of_its_page_runs(
    gateway: GatewayProcess, tokens: tuple[Path, dict[str, str]], tmp_path: Path
) -> None:
    page = (ROOT / "docs" / "java.md").read_text("utf-8")
    examples = re.findall(r"```java\n(.*?)```", page, re.DOTALL)
    names = [re.findall(r"public class (\w+)", example) for example in examples]
    assert len(names) >= 4
    for (name,), example in zip(names, examples, strict=True):
        (tmp_path / f"{name}.java").write_text(example, "utf-8")
    # all at once: the compiler takes longer to start than to compile them
    compiler = ["javac", "-J-XX:TieredStopAtLevel=1", "-cp", java()[-1], "-d", str(tmp_path)]
    run([*compiler, *map(str, tmp_path.glob("*.java"))])
    for (name,) in names:
        run([*java(tmp_path), name], MC_GATEWAY=gateway.ws, MC_TOKEN=tokens[1]["operator"])


def run(command: list[str], **variables: str) -> None:
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        env={**environment(), **variables},
        check=False,
    )
    assert done.returncode == 0, f"{command[-1]}: {done.stdout}{done.stderr}"
