"""Imports between the packages point down only."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

# The layers of the server, from the bottom up: a package may use what stands before it, nothing behind it or
# beside it on the same line. This is the one place where they are written down.
LAYERS: tuple[tuple[str, ...], ...] = (
    ("errors", "units", "terminal", "mckinematics"),
    ("processes",),
    ("can",),
    ("machine",),
    ("motion", "clearance"),
    ("gcode",),
    ("drives",),
    ("canopen",),
    ("drive_sim",),
    ("ethercat",),
    ("executor",),
    ("planning",),
    ("service", "simulation"),
    ("recorder",),
    ("net", "plot", "doors"),
    ("view", "doctor", "security", "language", "fleet_sim"),
    ("web", "foxglove"),
    ("gateway", "mqtt", "mtconnect", "opcua", "ros"),
    ("server", "contract"),
    ("cli",),
    ("__main__", "__init__"),
)
HEIGHT = {package: height for height, layer in enumerate(LAYERS) for package in layer}
# The folders of `mcserver.motion` likewise; those of one line may use each other.
MOTION_LAYERS = (("geometry", "kernels"), ("limits", "smoothing"), ("profile",), ("lookahead",))


def sources() -> list[Path]:
    return sorted((ROOT / "mcserver").rglob("*.py"))


def package_of(module: str) -> str | None:
    """The package of ours that a module belongs to, None for one of others."""
    first, _, rest = module.partition(".")
    if first == "mckinematics":
        return first
    return (rest.partition(".")[0] or "__init__") if first == "mcserver" else None


def package_at(file: Path) -> str:
    parts = file.with_suffix("").parts
    return parts[parts.index("mcserver") + 1]


def imports(file: Path) -> Iterator[tuple[int, str]]:
    """Every import of a file with its line; those in functions and under TYPE_CHECKING too."""
    for node in ast.walk(ast.parse(file.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, f"{file}:{node.lineno}: a relative import"
            for alias in node.names:
                # `from mcserver import units` names the package in the second place
                yield (
                    node.lineno,
                    f"{node.module}.{alias.name}" if node.module == "mcserver" else str(node.module),
                )


def violations(file: Path) -> list[str]:
    here = package_at(file)
    found = []
    for line, module in imports(file):
        used = package_of(module)
        if used in (None, here, "__init__"):
            continue
        assert used is not None
        if HEIGHT[used] >= HEIGHT[here]:
            found.append(f"{file.relative_to(ROOT)}:{line}: {here} uses {module}")
    return found


def test_every_package_has_a_layer() -> None:
    assert {package_at(file) for file in sources()} == set(HEIGHT) - {"mckinematics"}


def test_imports_point_down_only() -> None:
    assert [each for file in sources() for each in violations(file)] == []


def test_imports_between_the_folders_of_motion_point_down_only() -> None:
    height = {folder: at for at, layer in enumerate(MOTION_LAYERS) for folder in layer}
    files = list((ROOT / "mcserver" / "motion").glob("*/*.py"))
    assert {file.parent.name for file in files} == set(height)
    found = []
    for file in files:
        for line, module in imports(file):
            used = module.split(".")[2:3]
            if module.startswith("mcserver.motion.") and height.get(*used, -1) > height[file.parent.name]:
                found.append(f"{file.relative_to(ROOT)}:{line}: {module}")
    assert found == []


@pytest.mark.parametrize(
    "text",
    [
        "from mcserver.net.keys import Keys",
        "import mcserver.net.keys",
        "from mcserver import net",
        "def late():\n    from mcserver.net import keys",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from mcserver.net.keys import Keys",
    ],
)
def test_an_import_that_points_up_is_found_wherever_it_stands(
    text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(globals(), "ROOT", tmp_path)
    file = tmp_path / "mcserver" / "motion" / "planner.py"
    file.parent.mkdir(parents=True)
    file.write_text(text)
    assert len(violations(file)) == 1
