"""Each SDK is ready for its registry: what is packed is what is needed, with licence and description."""

from __future__ import annotations

import json
import tomllib
from xml.etree import ElementTree

import pytest

from tests.e2e.servers import ROOT
from tests.sdks.built import build
from tests.sdks.conftest import needed, typescript

CLIENTS = ROOT / "clients"
LICENCE = (ROOT / "LICENSE").read_text("utf-8")
MAVEN = "{http://maven.apache.org/POM/4.0.0}"


@pytest.mark.parametrize("language", ["go", "java", "python", "rust", "typescript"])
def test_an_sdk_has_the_licence_and_says_what_it_is(language: str) -> None:
    assert (CLIENTS / language / "LICENSE").read_text("utf-8") == LICENCE
    assert len((CLIENTS / language / "README.md").read_text("utf-8").splitlines()) > 5


def test_all_sdks_have_one_version() -> None:
    pom = ElementTree.parse(CLIENTS / "java" / "pom.xml").getroot()
    versions = {
        "java": pom.findtext(f"{MAVEN}version"),
        "python": tomllib.loads((CLIENTS / "python" / "pyproject.toml").read_text("utf-8"))["project"][
            "version"
        ],
        "rust": tomllib.loads((CLIENTS / "rust" / "Cargo.toml").read_text("utf-8"))["package"]["version"],
        "typescript": json.loads((CLIENTS / "typescript" / "package.json").read_text("utf-8"))["version"],
    }
    assert len(set(versions.values())) == 1, versions


def test_the_npm_package_has_its_code_types_and_licence_and_nothing_else() -> None:
    typescript()
    (packed,) = json.loads(
        build([needed("npm"), "pack", "--dry-run", "--json", "--ignore-scripts"], CLIENTS / "typescript")
    )
    names = {each["path"] for each in packed["files"]}
    assert {"LICENSE", "README.md", "package.json", "dist/index.js", "dist/index.d.ts"} <= names
    assert all(name.startswith("dist/") for name in names - {"LICENSE", "README.md", "package.json"})


def test_the_crate_has_its_sources_and_licence_and_nothing_else() -> None:
    command = [needed("cargo"), "package", "--list", "--allow-dirty", "--offline", "--locked"]
    names = set(build(command, CLIENTS / "rust").splitlines())
    assert {"LICENSE", "README.md", "Cargo.toml", "src/lib.rs"} <= names
    known = ("src/", "examples/", "Cargo.", "LICENSE", "README.md", ".cargo_vcs_info.json")
    assert all(name.startswith(known) for name in names), names
