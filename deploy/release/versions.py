"""The one version that every package carries, and its section of the changelog."""

from __future__ import annotations

import datetime
import re
from pathlib import Path

# Each has its version once in this form; Go takes it from the tag.
MANIFESTS = {
    "pyproject.toml": r'^version = "([^"]+)"',
    "kinematics/pyproject.toml": r'^version = "([^"]+)"',
    "clients/python/pyproject.toml": r'^version = "([^"]+)"',
    "clients/benchmark/pyproject.toml": r'^version = "([^"]+)"',
    "clients/gym/pyproject.toml": r'^version = "([^"]+)"',
    "clients/lerobot/pyproject.toml": r'^version = "([^"]+)"',
    "clients/rust/Cargo.toml": r'^version = "([^"]+)"',
    "clients/rust/Cargo.lock": r'name = "mcclient"\nversion = "([^"]+)"',
    "clients/typescript/package.json": r'^  "version": "([^"]+)"',
    "clients/typescript/package-lock.json": r'"name": "@mcserver/client",\n\s+"version": "([^"]+)"',
    "clients/java/pom.xml": r"^  <version>([^<]+)</version>",
    "editors/vscode/package.json": r'^  "version": "([^"]+)"',
}
VERSION = re.compile(r"\d+\.\d+\.\d+(?:rc\d+)?")
_UNRELEASED = "## [Unreleased]\n"


class NotReleasable(Exception):
    """What has to be put right first, a sentence for each."""

    def __init__(self, reasons: list[str]) -> None:
        super().__init__("\n".join(reasons))
        self.reasons = reasons


def version_of(root: Path) -> str:
    """Return the version of the packages.

    Raises:
        NotReleasable: they differ, or one has none.
    """
    found = {name: _versions(root, name) for name in MANIFESTS if (root / name).exists()}
    reasons = [f"{name} has no version in its usual place" for name, each in found.items() if not each]
    every = {version for each in found.values() for version in each}
    if len(every) > 1:
        said = ", ".join(f"{name} {'/'.join(sorted(each))}" for name, each in found.items())
        reasons.append(
            f"the versions differ: {said}; python -m deploy.release set VERSION gives all of them one"
        )
    if reasons:
        raise NotReleasable(reasons)
    return every.pop()


def changes_of(root: Path, version: str) -> str:
    """Return the changelog's section of a version.

    Raises:
        NotReleasable: it is missing, empty or without a date, or changes stand above it as unreleased.
    """
    text = (root / "CHANGELOG.md").read_text(encoding="utf-8")
    section = re.search(rf"^## \[{re.escape(version)}\](.*)\n((?:(?!## \[).*\n?)*)", text, re.MULTILINE)
    reasons = []
    if section is None or not section[2].strip():
        reasons.append(f"CHANGELOG.md says nothing of {version}: python -m deploy.release set {version}")
    elif not re.fullmatch(r" - \d{4}-\d\d-\d\d", section[1]):
        reasons.append(f"CHANGELOG.md has no date of {version}")
    open_changes = text.partition(_UNRELEASED)[2].partition("\n## [")[0]
    if open_changes.strip():
        reasons.append(f"CHANGELOG.md has unreleased changes beside {version}")
    if reasons or section is None:
        raise NotReleasable(reasons)
    return section[2].strip() + "\n"


def set_version(root: Path, version: str, today: datetime.date) -> list[str]:
    """Give every package a version, and the unreleased changes their section; the files that are changed.

    Raises:
        NotReleasable: it is no version, or the changelog has it already.
    """
    if not VERSION.fullmatch(version):
        raise NotReleasable([f"{version} is no version such as 1.2.3 or 1.2.3rc1"])
    changelog = root / "CHANGELOG.md"
    text = changelog.read_text(encoding="utf-8")
    if f"## [{version}]" in text:
        raise NotReleasable([f"CHANGELOG.md has {version} already: a version is released once"])
    changed = []
    for name, pattern in MANIFESTS.items():
        if not (root / name).exists():
            continue
        before = (root / name).read_text(encoding="utf-8")
        after = re.sub(
            pattern,
            lambda found: (
                found[0][: found.start(1) - found.start()]
                + version
                + found[0][found.end(1) - found.start() :]
            ),
            before,
            flags=re.MULTILINE,
        )
        if after != before:
            (root / name).write_text(after, encoding="utf-8")
            changed.append(name)
    changelog.write_text(
        text.replace(_UNRELEASED, f"{_UNRELEASED}\n## [{version}] - {today}\n", 1), encoding="utf-8"
    )
    return [*changed, "CHANGELOG.md"]


def _versions(root: Path, name: str) -> set[str]:
    text = (root / name).read_text(encoding="utf-8")
    return set(re.findall(MANIFESTS[name], text, re.MULTILINE))
