"""What a release is made of: a lock file with hashes, a bill of materials (CycloneDX), a list of licences."""

from __future__ import annotations

import importlib.util
import json
import sys
import tempfile
import venv
from pathlib import Path
from typing import Any

from deploy.release.commands import run

Bom = dict[str, Any]


def write_contents(root: Path, output: Path) -> Bom:
    """Write ``requirements.lock``, ``sbom.cdx.json`` and ``licences.md`` of what the server needs to run.

    The lock file has the versions of ``constraints.txt``, which the tests ran with; pip takes it with
    ``--require-hashes``.
    """
    lock, bom = output / "requirements.lock", output / "sbom.cdx.json"
    pins = [
        "--constraint",
        str(root / "constraints.txt"),
        "--generate-hashes",
        "--no-header",
        "--no-annotate",
    ]
    run(
        [
            sys.executable,
            "-m",
            "uv",
            "pip",
            "compile",
            "-q",
            *pins,
            "-o",
            str(lock),
            str(root / "pyproject.toml"),
        ],
        root,
    )
    with tempfile.TemporaryDirectory() as folder:
        venv.create(folder, with_pip=False)
        python = str(Path(folder) / "bin" / "python")
        install = ["pip", "install", "-q", "--python", python, "--require-hashes", "-r", str(lock)]
        run([sys.executable, "-m", "uv", *install], root)
        options = ["--pyproject", str(root / "pyproject.toml"), "--output-reproducible", "--of", "JSON"]
        run([sys.executable, "-m", "cyclonedx_py", "environment", *options, "-o", str(bom), python], root)
    found: Bom = json.loads(bom.read_text(encoding="utf-8"))
    (output / "licences.md").write_text(licences(found), encoding="utf-8")
    return found


def licences(bom: Bom) -> str:
    """Return the table of what is used under which licence."""
    rows = [
        f"| {each['name']} | {each['version']} | {_licence(each)} |"
        for each in sorted(bom["components"], key=lambda each: each["name"].lower())
    ]
    return "\n".join(["| package | version | licence |", "|---|---|---|", *rows]) + "\n"


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
