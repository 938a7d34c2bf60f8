"""Rules that code, documents and tests cite exist, and so do the modules and names that they refer to."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import pytest

from mcserver.language.rules import rules

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = {
    "mcserver": ROOT / "mcserver",
    "mckinematics": ROOT / "kinematics" / "mckinematics",
    "mcclient": ROOT / "clients" / "python" / "mcclient",
}
FOLDERS = ("mcserver", "kinematics", "clients", "docs", "tests", "examples", "deploy", "editors")
CITATION = re.compile(r"\bD-[0-9]+[a-z]?\b")
# the project's modules between backticks, once or twice, with or without a call's parentheses
REFERENCE = re.compile(r"(?<![\w`])`{1,2}((?:mcserver|mckinematics|mcclient)(?:\.\w+)+)(?:\(\))?`")
SKIPPED = {".venv", "node_modules", "build", "dist", "target", "__pycache__", "out"}


@cache
def written() -> list[Path]:
    """Every source and page."""
    pages = [*ROOT.glob("*.md"), *(path for folder in FOLDERS for path in (ROOT / folder).rglob("*"))]
    return [
        path
        for path in pages
        if path.suffix in (".py", ".md", ".toml", ".gcode", ".js", ".ts", ".rs", ".java")
        and not SKIPPED.intersection(path.parts)
        and path.is_file()
    ]


def test_every_rule_that_is_cited_has_an_anchor_in_the_dialects_page() -> None:
    anchors = set(re.findall(r'<a id="(d-\w+)"></a>', (ROOT / "docs" / "dialect.md").read_text("utf-8")))
    assert anchors == {rule.anchor for rule in rules().values()}
    cited: dict[str, set[str]] = {}
    for path in written():
        for name in CITATION.findall(path.read_text("utf-8")):
            cited.setdefault(name, set()).add(str(path.relative_to(ROOT)))
    assert "D-22" in cited
    missing = {name: sorted(paths) for name, paths in cited.items() if name.lower() not in anchors}
    assert missing == {}


def test_links_to_rules_lead_to_their_anchors() -> None:
    for path in written():
        if path.suffix != ".md":
            continue
        for target in re.findall(r"\]\((?:[\w./]*dialect\.md)?#(d-[0-9]\w*)\)", path.read_text("utf-8")):
            assert target.upper().replace("A", "a") in rules(), f"{path}: #{target}"


@cache
def spoken_names() -> set[str]:
    """Dotted names that the code itself has as text: schemas of recordings, commands of editors."""
    quoted = re.compile(r'"(mcserver\.\w+)"')
    return {
        name for path in (ROOT / "mcserver").rglob("*.py") for name in quoted.findall(path.read_text("utf-8"))
    }


def names_of(module: Path) -> dict[str, ast.ClassDef | str | None]:
    """What a module defines at its top: classes with their bodies, imported names with their source."""
    names: dict[str, ast.ClassDef | str | None] = {}
    waiting: list[ast.AST] = [ast.parse(module.read_text("utf-8"))]
    while waiting:
        for node in ast.iter_child_nodes(waiting.pop()):
            match node:
                case ast.ClassDef():
                    names[node.name] = node
                case ast.FunctionDef() | ast.AsyncFunctionDef():
                    names[node.name] = None
                case ast.Assign() | ast.AnnAssign():
                    targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                    names.update(
                        {
                            each.id: None
                            for target in targets
                            for each in ast.walk(target)
                            if isinstance(each, ast.Name)
                        }
                    )
                case ast.ImportFrom():
                    source = node.module or ""
                    names.update(
                        {alias.asname or alias.name: f"{source}.{alias.name}" for alias in node.names}
                    )
                case ast.Import():
                    names.update({(alias.asname or alias.name).split(".")[0]: None for alias in node.names})
                case ast.If() | ast.Try() | ast.ExceptHandler():
                    waiting.append(node)
    return names


def resolves(reference: str) -> bool:
    """Whether a dotted name is a package, a module, or something at the top of one."""
    package, *parts = reference.split(".")
    place = PACKAGES[package]
    while parts and (place / parts[0]).is_dir():
        place /= parts.pop(0)
    if not parts:
        return place.is_dir()
    if (place / f"{parts[0]}.py").is_file():
        place /= f"{parts.pop(0)}.py"
    else:
        place /= "__init__.py"
    if not parts:
        return True
    names = names_of(place) if place.is_file() else {}
    if parts[0] not in names:
        return False
    body = names[parts[0]]
    if isinstance(body, str) and len(parts) > 1 and body.split(".")[0] in PACKAGES:
        return resolves(".".join([body, *parts[1:]]))
    if len(parts) == 1 or not isinstance(body, ast.ClassDef):
        return len(parts) == 1
    members = {node.name for node in body.body if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)}
    members |= {
        node.target.id
        for node in body.body
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)
    }
    if len(parts) == 2 and parts[1] in members:
        return True
    # inherited, from a class of another module
    bases = [names.get(base.id) for base in body.bases if isinstance(base, ast.Name)]
    return any(isinstance(base, str) and resolves(".".join([base, *parts[1:]])) for base in bases)


def test_every_dotted_reference_leads_to_a_module_or_a_name_in_one() -> None:
    found = [
        (str(path.relative_to(ROOT)), name)
        for path in written()
        if path.suffix in (".py", ".md")
        for name in REFERENCE.findall(path.read_text("utf-8"))
    ]
    assert len(found) > 50
    spoken = spoken_names()
    missing = [each for each in found if each[1] not in spoken and not resolves(each[1])]
    assert missing == []


@pytest.mark.parametrize(
    ("name", "there"),
    [
        ("mcserver.gcode", True),
        ("mcserver.gcode.text.scanner", True),
        ("mcserver.gcode.text.scanner.TOKEN", True),
        ("mcserver.gcode.text.parser.ParsedLine.span", True),
        ("mcserver.gcode.text.scanner.NOTHING", False),
        ("mcserver.gcode.nothing", False),
        ("mcclient.Machine", True),
        ("mcclient.Machines", False),
        ("mcclient.Machine.jog", True),
        ("mcclient.Machine.jig", False),
    ],
)
def test_the_check_of_references_can_fail(name: str, there: bool) -> None:
    assert resolves(name) == there
