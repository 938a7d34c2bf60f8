"""Licences of what the SDKs of other languages need, as their package managers know them."""

from __future__ import annotations

import json
import re
import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

from deploy.release.commands import run

# texts of licences by words that no other one has; Go's modules declare none. The first that fits counts
TEXTS = (
    ("Apache-2.0", "Apache License"),
    ("MPL-2.0", "Mozilla Public License"),
    ("BSD-3-Clause", "Neither the name"),
    ("BSD-2-Clause", "Redistribution and use"),
    ("ISC", "Permission to use, copy, modify, and/or distribute"),
    ("ISC", "Permission to use, copy, modify, and distribute"),
    ("MIT", "Permission is hereby granted, free of charge"),
)
UNKNOWN = "not declared"


class Package(NamedTuple):
    """A package of others, and its licence."""

    name: str
    version: str
    licence: str


def of_crate(folder: Path) -> list[Package]:
    """Return the crates that a crate is built with, on any system, without those of its tests alone."""
    found = json.loads(run(["cargo", "metadata", "--format-version", "1", "--locked"], folder))
    needs = {
        node["id"]: [
            each["pkg"] for each in node["deps"] if any(kind["kind"] != "dev" for kind in each["dep_kinds"])
        ]
        for node in found["resolve"]["nodes"]
    }
    root = found["resolve"]["root"]
    reached, waiting = {root}, [root]
    while waiting:
        new = set(needs[waiting.pop()]) - reached
        reached |= new
        waiting += new
    return [
        Package(each["name"], each["version"], each["license"] or UNKNOWN)
        for each in found["packages"]
        if each["id"] in reached - {root}
    ]


def of_npm(folder: Path) -> list[Package]:
    """Return the packages in a lock file, without those for development."""
    lock = json.loads((folder / "package-lock.json").read_text("utf-8"))
    return [
        Package(path.rpartition("node_modules/")[2], each["version"], each.get("license", UNKNOWN))
        for path, each in lock["packages"].items()
        if path and not each.get("dev")
    ]


def of_go(folder: Path) -> list[Package]:
    """Return the modules that a module is built with; the licence is known by its text."""
    form = "{{with .Module}}{{if .Version}}{{.Path}} {{.Version}} {{.Dir}}{{end}}{{end}}"
    lines = {line for line in run(["go", "list", "-deps", "-f", form, "./..."], folder).splitlines() if line}
    return [
        Package(name, version, licence_in(Path(place)))
        for name, version, place in (line.split(" ", 2) for line in sorted(lines))
    ]


def licence_in(folder: Path) -> str:
    """Return the licence whose text is in a folder."""
    files = [each for each in sorted(folder.iterdir()) if re.match(r"LICEN[CS]E|COPYING", each.name, re.I)]
    text = " ".join(" ".join(each.read_text("utf-8") for each in files if each.is_file()).split())
    return next((name for name, words in TEXTS if words in text), UNKNOWN)


def of_jar(folder: Path) -> list[Package]:
    """Return the artifacts that a project runs with, by their descriptions in the local repository."""
    with tempfile.TemporaryDirectory() as temporary:
        listed = Path(temporary) / "list"
        options = ["-DincludeScope=runtime", f"-DoutputFile={listed}"]
        run(["mvn", "--quiet", "--batch-mode", "dependency:list", *options], folder)
        lines = re.findall(r"^ +([\w.-]+):([\w.-]+):jar:([\w.-]+):", listed.read_text("utf-8"), re.MULTILINE)
    kept = Path.home() / ".m2" / "repository"
    return [
        Package(f"{group}:{name}", version, licence_of_pom(kept, group, name, version))
        for group, name, version in lines
    ]


def licence_of_pom(repository: Path, group: str, name: str, version: str) -> str:
    """Return the licences that an artifact's description has, or the one that it descends from."""
    file = repository.joinpath(*group.split("."), name, version, f"{name}-{version}.pom")
    pom = ElementTree.parse(file).getroot()
    for element in pom.iter():
        element.tag = element.tag.rpartition("}")[2]
    said = [each.text for each in pom.findall("licenses/license/name") if each.text]
    parent = pom.find("parent")
    if not said and parent is not None:
        values = (parent.findtext(each, "") for each in ("groupId", "artifactId", "version"))
        return licence_of_pom(repository, *values)
    return ", ".join(said) or UNKNOWN


SDKS: Mapping[str, tuple[str, Callable[[Path], list[Package]]]] = {
    "rust": ("clients/rust", of_crate),
    "typescript": ("clients/typescript", of_npm),
    "java": ("clients/java", of_jar),
    "go": ("clients/go", of_go),
}


def sdk_licences(root: Path, language: str) -> str:
    """Return the section of an SDK: what it needs under which licence."""
    folder, packages_of = SDKS[language]
    found = sorted(packages_of(root / folder), key=lambda each: (each.name.lower(), each.version))
    rows = [f"| {each.name} | {each.version} | {each.licence} |" for each in found]
    return f"\n## {folder}\n\n| package | version | licence |\n|---|---|---|\n" + "\n".join(rows) + "\n"
