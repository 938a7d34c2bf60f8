"""The packages of a release, each built as its registry wants it; Python's twice, to the same bytes."""

from __future__ import annotations

import hashlib
import shutil
import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path

from deploy.release.commands import run
from deploy.release.versions import NotReleasable

PYTHON = {
    "mcserver": ".",
    "mckinematics": "kinematics",
    "mcclient": "clients/python",
    "mcbenchmark": "clients/benchmark",
    "mcclient_gym": "clients/gym",
    "lerobot_robot_mcserver": "clients/lerobot",
}


def build_python(root: Path, output: Path, epoch: str, bom: Path | None) -> None:
    """Build wheels and source distributions; the server's wheel gets its bill of materials (PEP 770).

    Args:
        epoch: time of the commit [s], which every file in them carries.

    Raises:
        NotReleasable: a second build gives other bytes.
    """
    digests = []
    for _ in range(2):
        with tempfile.TemporaryDirectory() as folder:
            made = Path(folder)
            for name, project in PYTHON.items():
                build = [
                    sys.executable,
                    "-m",
                    "build",
                    "--no-isolation",
                    "--outdir",
                    str(made),
                    str(root / project),
                ]
                run(build, root, {"SOURCE_DATE_EPOCH": epoch})
                if name == "mcserver" and bom is not None:
                    _add_bom(made, bom, epoch)
            digests.append(digests_of(made))
            if len(digests) == 1:
                _copy(made, "*", output)
    if digests[0] != digests[1]:
        other = [name for name in digests[0] if digests[0][name] != digests[1].get(name)]
        raise NotReleasable([f"two builds of {', '.join(other)} have different bytes"])


def _add_bom(folder: Path, bom: Path, epoch: str) -> None:
    (wheel,) = folder.glob("mcserver-*.whl")
    with tempfile.TemporaryDirectory() as temporary:
        run([sys.executable, "-m", "wheel", "unpack", "--dest", temporary, str(wheel)], folder)
        (unpacked,) = Path(temporary).iterdir()
        (info,) = unpacked.glob("*.dist-info")
        (info / "sboms").mkdir()
        shutil.copy(bom, info / "sboms" / bom.name)
        pack = [sys.executable, "-m", "wheel", "pack", "--dest-dir", str(folder), str(unpacked)]
        run(pack, folder, {"SOURCE_DATE_EPOCH": epoch})


def build_crate(root: Path, output: Path, _version: str) -> None:
    """Build the Rust SDK's crate."""
    with tempfile.TemporaryDirectory() as target:
        options = ["--locked", "--no-verify", "--target-dir", target]
        run(["cargo", "package", *options], root / "clients" / "rust")
        _copy(Path(target) / "package", "*.crate", output)


def build_npm(root: Path, output: Path, _version: str) -> None:
    """Build the TypeScript SDK's package."""
    folder = root / "clients" / "typescript"
    run(["npm", "ci", "--silent", "--no-audit", "--no-fund"], folder)
    run(["npm", "pack", "--silent", "--pack-destination", str(output)], folder)


def build_jar(root: Path, output: Path, _version: str) -> None:
    """Build the Java SDK's jar, and its description for a repository."""
    folder = root / "clients" / "java"
    time = run(["git", "log", "-1", "--format=%cI"], root).strip()
    options = ["--quiet", "--batch-mode", "-DskipTests", f"-Dproject.build.outputTimestamp={time}"]
    run(["mvn", *options, "package"], folder)
    _copy(folder / "target", "mcclient-*.jar", output)
    shutil.copy(folder / "pom.xml", output / "mcclient.pom")


def build_go(root: Path, output: Path, version: str) -> None:
    """Build the Go SDK's sources; a proxy takes them from the tag ``clients/go/vVERSION``."""
    archive = output / f"mcclient-go-{version}.zip"
    # of the commit, whose time its files carry: a folder's tree (HEAD:clients/go) has none
    words = ["git", "archive", "--format", "zip", "--output", str(archive), "HEAD"]
    run(words, root / "clients" / "go", {"TZ": "UTC"})


OTHERS: Mapping[str, Callable[[Path, Path, str], None]] = {
    "rust": build_crate,
    "typescript": build_npm,
    "java": build_jar,
    "go": build_go,
}


def digests_of(folder: Path) -> dict[str, str]:
    """Return the SHA-256 of each file of a folder, by name."""
    return {
        file.name: hashlib.sha256(file.read_bytes()).hexdigest()
        for file in sorted(folder.iterdir())
        if file.is_file()
    }


def _copy(folder: Path, pattern: str, output: Path) -> None:
    for file in folder.glob(pattern):
        shutil.copy(file, output)
