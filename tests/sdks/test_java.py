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

EXAMPLE_LIMIT_S = 60.0
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
    assert len(examples) >= 4
    for example in examples:
        name = re.search(r"public class (\w+)", example)
        assert name is not None
        source = tmp_path / f"{name[1]}.java"
        source.write_text(example, "utf-8")
        done = subprocess.run(
            [*java(), str(source)],
            capture_output=True,
            text=True,
            timeout=EXAMPLE_LIMIT_S,
            env={**environment(), "MC_GATEWAY": gateway.ws, "MC_TOKEN": tokens[1]["operator"]},
            check=False,
        )
        assert done.returncode == 0, f"{name[1]}: {done.stdout}{done.stderr}"
