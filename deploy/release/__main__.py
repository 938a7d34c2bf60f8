"""Releases: ``python -m deploy.release set VERSION``, ``go PATH``, ``check``, ``build``: deploy/release.md.

``set`` gives every package the version, and the unreleased changes their section; commit and tag that.
``go`` gives the Go module its path, once.
``build`` makes everything from the commit that is checked out, into a folder, and uploads nothing.
"""

from __future__ import annotations

import argparse
import datetime
import importlib.util
import sys
import tempfile
from pathlib import Path

from deploy.release import contents, packages
from deploy.release.commands import run
from deploy.release.go_module import set_go_module
from deploy.release.sdk_licences import sdk_licences
from deploy.release.versions import NotReleasable, changes_of, set_version, version_of

ROOT = Path(__file__).parents[2]
EXTRA = "pip install -e '.[release]' gives what a release is built with"


def check(root: Path) -> str:
    """Return the version that can be released from what is checked out.

    Raises:
        NotReleasable: all that stands in the way.
    """
    version = version_of(root)
    reasons = []
    try:
        changes_of(root, version)
    except NotReleasable as found:
        reasons += found.reasons
    if run(["git", "status", "--porcelain"], root).strip():
        reasons.append("files are changed or new beside the commit: commit or remove them")
    if f"v{version}" not in run(["git", "tag", "--points-at", "HEAD"], root).split():
        reasons.append(f"the commit has no tag: git tag -s v{version} && git tag -s clients/go/v{version}")
    if reasons:
        raise NotReleasable(reasons)
    return version


def build(root: Path, output: Path, version: str, without: frozenset[str]) -> None:
    """Write packages, lock file, bill of materials, licences, changes and sums into an empty folder.

    Raises:
        NotReleasable: something cannot be built, or the folder has files.
    """
    if not contents.is_installed():
        raise NotReleasable([EXTRA])
    if output.exists() and any(output.iterdir()):
        raise NotReleasable([f"{output} has files: give an empty folder"])
    output.mkdir(parents=True, exist_ok=True)
    epoch = run(["git", "log", "-1", "--format=%ct"], root).strip()
    with tempfile.TemporaryDirectory() as folder:
        # only what is committed gets into a package
        source = Path(folder) / "source"
        run(["git", "worktree", "add", "--detach", "--quiet", str(source), "HEAD"], root)
        try:
            contents.write_contents(source, output)
            packages.build_python(source, output, epoch, output / "sbom.cdx.json")
            for name, make in packages.OTHERS.items():
                if name not in without:
                    print(f"{name} …", file=sys.stderr)
                    make(source, output, version)
                    with (output / "licences.md").open("a", encoding="utf-8") as licences:
                        licences.write(sdk_licences(source, name))
            (output / "changes.md").write_text(changes_of(source, version), encoding="utf-8")
        finally:
            run(["git", "worktree", "remove", "--force", str(source)], root)
    sums = "".join(f"{digest}  {name}\n" for name, digest in packages.digests_of(output).items())
    (output / "SHA256SUMS").write_text(sums, encoding="utf-8")


def main() -> int:
    """The exit code: 1 where something stands in the way, which is listed."""
    options = argparse.ArgumentParser(prog="python -m deploy.release", description=__doc__)
    asked = options.add_subparsers(dest="what", required=True)
    asked.add_parser("set", help="give every package a version").add_argument("version")
    asked.add_parser("go", help="give the Go module its path").add_argument("path")
    asked.add_parser("check", help="say what stands in the way of a release")
    building = asked.add_parser("build", help="build every package")
    building.add_argument("--output", type=Path, default=Path("out/release"))
    building.add_argument("--without", default="", help=f"of {', '.join(packages.OTHERS)}, with commas")
    building.add_argument(
        "--sign", action="store_true", help="sign the sums by sigstore, which asks who you are"
    )
    chosen = options.parse_args()
    try:
        if chosen.what == "set":
            print("\n".join(set_version(ROOT, chosen.version, datetime.datetime.now(tz=datetime.UTC).date())))
            return 0
        if chosen.what == "go":
            print("\n".join(set_go_module(ROOT, chosen.path)))
            return 0
        version = check(ROOT)
        if chosen.what == "build":
            if chosen.sign and not importlib.util.find_spec("sigstore"):
                raise NotReleasable(["signing needs sigstore: pip install sigstore"])
            build(ROOT, chosen.output.resolve(), version, frozenset(chosen.without.split(",")))
            if chosen.sign:
                run([sys.executable, "-m", "sigstore", "sign", str(chosen.output / "SHA256SUMS")], ROOT)
            print(f"{version} is in {chosen.output}")
        else:
            print(f"{version} can be built")
    except NotReleasable as found:
        print("\n".join(f"- {reason}" for reason in found.reasons), file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
