"""Python and the packages, required and optional."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from importlib.metadata import PackageNotFoundError, version

import msgspec

from mcserver.doctor.finding import Finding, advice, good, missing

AREA = "python"
OLDEST = (3, 11)


class Package(msgspec.Struct, frozen=True):
    """A package that the server uses.

    Attributes:
        distribution, module: its names for pip and for ``import``.
        extra: the optional part that brings it; empty: required.
        gives: what is lost without it.
    """

    distribution: str
    module: str
    extra: str
    gives: str


PACKAGES = (
    Package("eclipse-zenoh", "zenoh", "", "the network"),
    Package("ruckig", "ruckig", "", "independent motion"),
    Package("pin", "pinocchio", "", "tools and inverse kinematics"),
    Package("scipy", "scipy", "", "tools and inverse kinematics"),
    Package("canopen", "canopen", "", "CiA 402 drives"),
    Package("python-can", "can", "", "drives on a CAN bus"),
    Package("matplotlib", "matplotlib", "plot", "mcserver plot"),
)


class PythonFacts(msgspec.Struct, frozen=True):
    """Version of Python, and of each package (None: not installed; a text that starts with ``!``: broken)."""

    python: tuple[int, int, int]
    versions: dict[str, str | None]


def probe_python() -> PythonFacts:
    """Look packages up; required ones are imported in truth, optional ones only found."""
    return PythonFacts(
        python=(sys.version_info.major, sys.version_info.minor, sys.version_info.micro),
        versions={package.distribution: _version_of(package) for package in PACKAGES},
    )


def _version_of(package: Package) -> str | None:
    try:
        if importlib.util.find_spec(package.module) is None:
            return None
        if not package.extra:
            importlib.import_module(package.module)
        return version(package.distribution)
    except PackageNotFoundError:
        return "of unknown version"
    except Exception as error:  # a broken native library raises what it likes
        return f"!{type(error).__name__}: {error}"


def judge_python(facts: PythonFacts) -> list[Finding]:
    """Findings about Python and its packages."""
    shown = ".".join(map(str, facts.python))
    findings = [
        good(AREA, "Python", shown)
        if facts.python[:2] >= OLDEST
        else missing(AREA, "Python", shown, "install Python 3.11 or later")
    ]
    for package in PACKAGES:
        found = facts.versions.get(package.distribution)
        if found is not None and not found.startswith("!"):
            findings.append(good(AREA, package.distribution, found))
            continue
        state = "not installed" if found is None else f"does not load: {found[1:]}"
        if package.extra:
            fix = f"for {package.gives}: pip install 'mcserver[{package.extra}]'"
            findings.append(advice(AREA, package.distribution, state, fix))
        else:
            fix = f"for {package.gives}: pip install --force-reinstall {package.distribution}"
            findings.append(missing(AREA, package.distribution, state, fix))
    return findings
