"""What a release is made of: a lock file with hashes, a bill of materials (CycloneDX), a list of licences."""

from __future__ import annotations

import importlib.util
import json
import re
import sys
import tempfile
import tomllib
import venv
from collections.abc import Collection
from pathlib import Path
from typing import Any

from deploy.release.commands import run

Bom = dict[str, Any]

NAME = re.compile(r"[A-Za-z0-9._-]+")
OWN = ("mcserver", "mckinematics", "mcclient")


def write_contents(root: Path, output: Path) -> Bom:
    """Write ``requirements.lock``, ``sbom.cdx.json`` and ``licences.md``.

    The first two are of what the server needs to run, the list of licences also of what its extras and the
    Python SDK need. The versions are those of ``constraints.txt``, which the tests ran with; pip takes the
    lock file with ``--require-hashes``.
    """
    lock, bom = output / "requirements.lock", output / "sbom.cdx.json"
    _write_lock(root, root / "pyproject.toml", lock)
    found = _write_bom(root, lock, bom)
    with tempfile.TemporaryDirectory() as folder:
        wanted, all_lock = Path(folder) / "extras.in", Path(folder) / "extras.lock"
        wanted.write_text("\n".join(needed_with_extras(root)), encoding="utf-8")
        _write_lock(root, wanted, all_lock)
        everything = _write_bom(root, all_lock, Path(folder) / "extras.json")
    needed = {each["name"] for each in found["components"]}
    (output / "licences.md").write_text(licences(everything, needed), encoding="utf-8")
    return found


def needed_with_extras(root: Path) -> list[str]:
    """Return what the server, its extras and the Python SDK need of others' packages."""
    found: set[str] = set()
    for folder in (root, root / "clients" / "python"):
        project = tomllib.loads((folder / "pyproject.toml").read_text("utf-8"))["project"]
        optional = project.get("optional-dependencies", {})
        found.update(
            project["dependencies"], *(needs for name, needs in optional.items() if name != "release")
        )
    return sorted(each for each in found if NAME.match(each)[0] not in OWN)  # type: ignore[index]


def _write_lock(root: Path, wanted: Path, lock: Path) -> None:
    pins = ["--constraint", str(root / "constraints.txt")]
    options = ["--generate-hashes", "--no-header", "--no-annotate", *pins, "-o", str(lock)]
    run([sys.executable, "-m", "uv", "pip", "compile", "-q", *options, str(wanted)], root)


def _write_bom(root: Path, lock: Path, bom: Path) -> Bom:
    with tempfile.TemporaryDirectory() as folder:
        venv.create(folder, with_pip=False)
        python = str(Path(folder) / "bin" / "python")
        install = ["pip", "install", "-q", "--python", python, "--require-hashes", "-r", str(lock)]
        run([sys.executable, "-m", "uv", *install], root)
        options = ["--pyproject", str(root / "pyproject.toml"), "--output-reproducible", "--of", "JSON"]
        run([sys.executable, "-m", "cyclonedx_py", "environment", *options, "-o", str(bom), python], root)
    found: Bom = json.loads(bom.read_text(encoding="utf-8"))
    return found


def licences(bom: Bom, needed: Collection[str]) -> str:
    """Return the table of what is used under which licence.

    Args:
        needed: names of what the server does not run without; the others belong to extras or to the SDK.
    """
    rows = []
    for each in sorted(bom["components"], key=lambda each: each["name"].lower()):
        extra = "" if each["name"] in needed else "yes"
        rows.append(f"| {each['name']} | {each['version']} | {_licence(each)} | {extra} |")
    head = "## mcserver, mcclient\n\n| package | version | licence | extras alone |\n|---|---|---|---|\n"
    return head + "\n".join(rows) + "\n"


def _licence(component: Bom) -> str:
    """Return a component's licences; those of classifiers only where it declares none in SPDX's terms."""
    said = [
        each.get("expression") or each["license"].get("id") or each["license"].get("name", "")
        for each in component.get("licenses", [])
    ]
    # a whole text stands where the author wrote it into the field
    short = [each.splitlines()[0] for each in said if each]
    return ", ".join(dict.fromkeys(short)) or "not declared"


def is_installed() -> bool:
    """Return whether the tools are there (the extra ``release``)."""
    return all(
        importlib.util.find_spec(each) for each in ("build", "cyclonedx_py", "hatchling", "uv", "wheel")
    )
