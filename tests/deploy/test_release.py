"""A release: one version everywhere, its changes, and what stands in the way."""

from __future__ import annotations

import datetime
import shutil
import subprocess
import zipfile
from pathlib import Path

import pytest

from deploy.release import sdk_licences
from deploy.release.__main__ import build, check
from deploy.release.contents import licences
from deploy.release.go_module import set_go_module
from deploy.release.packages import build_go
from deploy.release.versions import MANIFESTS, NotReleasable, changes_of, set_version, version_of

ROOT = Path(__file__).parents[2]
DAY = datetime.date(2030, 1, 2)


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """The manifests and the changelog, committed."""
    for name in MANIFESTS:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    (tmp_path / "CHANGELOG.md").write_text("# Changelog\n\n## [Unreleased]\n\n### Added\n\n- arcs\n")
    git(tmp_path, "init", "--quiet")
    commit(tmp_path)
    return tmp_path


def git(folder: Path, *words: str) -> None:
    who = ["-c", "user.name=a", "-c", "user.email=a@example.org", "-c", "commit.gpgsign=false"]
    subprocess.run(["git", *who, *words], cwd=folder, check=True, capture_output=True)


def commit(folder: Path) -> None:
    git(folder, "add", "--all")
    git(folder, "commit", "--quiet", "--message", "state")


def reasons(folder: Path) -> str:
    with pytest.raises(NotReleasable) as found:
        check(folder)
    return "\n".join(found.value.reasons)


def test_every_package_has_the_same_version() -> None:
    assert version_of(ROOT)


def test_a_version_is_set_everywhere_and_then_nothing_but_the_tag_is_missing(project: Path) -> None:
    assert set(set_version(project, "7.1.0", DAY)) == {*MANIFESTS, "CHANGELOG.md"}
    assert version_of(project) == "7.1.0"
    assert changes_of(project, "7.1.0") == "### Added\n\n- arcs\n"
    assert "files are changed" in reasons(project)
    commit(project)
    assert reasons(project) == "the commit has no tag: git tag -s v7.1.0 && git tag -s clients/go/v7.1.0"
    git(project, "tag", "v7.1.0")
    assert check(project) == "7.1.0"


def test_packages_of_two_versions_are_not_released(project: Path) -> None:
    manifest = project / "clients" / "rust" / "Cargo.toml"
    manifest.write_text(
        manifest.read_text().replace(f'version = "{version_of(ROOT)}"', 'version = "9.9.9"', 1)
    )
    assert "clients/rust/Cargo.toml 9.9.9" in reasons(project)


def test_changes_that_are_not_of_the_version_are_not_released(project: Path) -> None:
    set_version(project, "7.1.0", DAY)
    changelog = project / "CHANGELOG.md"
    changelog.write_text(changelog.read_text().replace("## [Unreleased]\n", "## [Unreleased]\n\n- later\n"))
    assert "unreleased changes beside 7.1.0" in reasons(project)


@pytest.mark.parametrize("version", ["7", "7.1", "v7.1.0", "7.1.0-dev", "7.1.0\n"])
def test_what_is_no_version_is_refused(project: Path, version: str) -> None:
    with pytest.raises(NotReleasable):
        set_version(project, version, DAY)


def test_a_version_is_released_once(project: Path) -> None:
    set_version(project, "7.1.0", DAY)
    with pytest.raises(NotReleasable, match="already"):
        set_version(project, "7.1.0", DAY)


def test_the_path_of_the_go_module_is_set_in_all_that_names_it(project: Path) -> None:
    shutil.copytree(ROOT / "clients" / "go", project / "clients" / "go")
    commit(project)
    path = "git.example.org/motion/server/clients/go"
    changed = set_go_module(project, path)
    assert {"clients/go/go.mod", "clients/go/cmd/conformance/main.go"} <= set(changed)
    assert (project / "clients" / "go" / "go.mod").read_text().startswith(f"module {path}\n")
    assert "mcserver.example/mcclient" not in "".join((project / name).read_text() for name in changed)


@pytest.mark.parametrize(
    "path", ["mcclient", "github.com/owner/mcclient", "https://github.com/o/r/clients/go"]
)
def test_a_path_from_which_go_cannot_fetch_the_module_is_refused(project: Path, path: str) -> None:
    with pytest.raises(NotReleasable):
        set_go_module(project, path)


def test_the_files_of_the_go_module_carry_the_time_of_the_commit(
    project: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    (project / "clients" / "go").mkdir()
    (project / "clients" / "go" / "go.mod").write_text("module mcserver.example/mcclient\n")
    monkeypatch.setenv("GIT_COMMITTER_DATE", "2030-01-02T03:04:06Z")
    commit(project)
    monkeypatch.setenv("TZ", "Asia/Tokyo")
    output = tmp_path_factory.mktemp("out")
    build_go(project, output, "7.1.0")
    with zipfile.ZipFile(output / "mcclient-go-7.1.0.zip") as archive:
        (file,) = archive.infolist()
    assert (file.filename, file.date_time) == ("go.mod", (2030, 1, 2, 3, 4, 6))


def test_a_folder_with_files_is_left_alone(project: Path) -> None:
    with pytest.raises(NotReleasable):
        build(project, project, "7.1.0", frozenset())


def test_licences_are_those_that_each_component_declares() -> None:
    components = [
        {"name": "b", "version": "1", "licenses": [{"license": {"name": "MIT\nlong text"}}]},
        {
            "name": "A",
            "version": "2",
            "licenses": [{"expression": "MIT OR Zlib"}, {"license": {"id": "Zlib"}}],
        },
        {"name": "c", "version": "3"},
    ]
    assert licences({"components": components}, {"A", "c"}).splitlines()[4:] == [
        "| A | 2 | MIT OR Zlib, Zlib |  |",
        "| b | 1 | MIT | yes |",
        "| c | 3 | not declared |  |",
    ]


def test_the_typescript_sdk_needs_one_package_and_none_for_development_is_listed() -> None:
    (package,) = sdk_licences.of_npm(ROOT / "clients" / "typescript")
    assert (package.name, package.licence) == ("@msgpack/msgpack", "ISC")


def test_the_licence_of_an_artifact_may_stand_in_what_it_descends_from(tmp_path: Path) -> None:
    space = 'xmlns="http://maven.apache.org/POM/4.0.0"'
    parent = "<parent><groupId>org.a</groupId><artifactId>all</artifactId><version>1</version></parent>"
    licence = "<licenses><license><name>EPL-2.0</name></license></licenses>"
    for name, text in (("all", licence), ("part", parent)):
        folder = tmp_path / "org" / "a" / name / "1"
        folder.mkdir(parents=True)
        (folder / f"{name}-1.pom").write_text(f"<project {space}>{text}</project>")
    assert sdk_licences.licence_of_pom(tmp_path, "org.a", "part", "1") == "EPL-2.0"


@pytest.mark.parametrize(
    ("text", "licence"),
    [
        ("MIT License\n\nPermission is hereby granted, free of\ncharge, to any person", "MIT"),
        ("Redistribution and use in source\n * Neither the name of", "BSD-3-Clause"),
        ("all rights reserved", "not declared"),
    ],
)
def test_the_licence_of_a_go_module_is_known_by_its_text(tmp_path: Path, text: str, licence: str) -> None:
    (tmp_path / "LICENSE.txt").write_text(text)
    assert sdk_licences.licence_in(tmp_path) == licence
