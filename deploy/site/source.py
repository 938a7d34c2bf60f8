"""Source of the site: the repository's pages, what they link to, and references made from the source."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path
from urllib.parse import unquote

import mcclient.cli.app
import typer
from typer.cli import get_docs_for_click

import mcserver.cli.app
from deploy.site.references import codes_of, codes_page, keys_page

# what a link or a picture of Markdown points to, without the place in the page
LINK = re.compile(r"\]\(\s*<?([^)\s#>]+)")
# for those who work on the repository, and made from other pages
LEFT_OUT = ("mcserver/", "tests/", ".")
# folders whose pages say what codes mean
EXPLAIN = ("docs", "deploy")
HERE = Path(__file__).parent

API = """# API of the Python SDK

[The guide](sdk.md) has this in the order in which one needs it.
`mcclient.sync` has the same calls without `async`.

::: mcclient
"""


def write_source(root: Path, target: Path) -> None:
    """Write all that the site is built from below ``target``, in the places that it has below ``root``.

    Raises:
        FileNotFoundError: a page links to a file that the repository lacks.
    """
    shutil.rmtree(target, ignore_errors=True)
    pages = [path for path in _tracked(root) if path.suffix == ".md"]
    for page in pages:
        _copy(root, target / "pages", page)
        for linked in _linked(root, page):
            _copy(root, target / "pages", linked)
    made = target / "pages" / "docs"
    (made / "commands.md").write_text(_commands(), "utf-8")
    (made / "api.md").write_text(API, "utf-8")
    (made / "keys.md").write_text(keys_page(), "utf-8")
    texts = {page.as_posix(): (root / page).read_text("utf-8") for page in pages if page.parts[0] in EXPLAIN}
    (made / "codes.md").write_text(codes_page(codes_of(root), texts, "docs/codes.md"), "utf-8")
    # a question finds questions and guides first
    last = (
        made / "api.md",
        made / "commands.md",
        made / "codes.md",
        made / "keys.md",
        target / "pages" / "CHANGELOG.md",
    )
    boosts = [(page, 0.1) for page in last]
    boosts += [(page, 0.3) for page in (made / "wire").glob("*.md")] + [(made / "questions.md", 2.0)]
    for page, boost in boosts:
        page.write_text(f"---\nsearch:\n  boost: {boost}\n---\n" + page.read_text("utf-8"), "utf-8")
    shutil.copy(HERE / "mkdocs.yml", target)


def _tracked(root: Path) -> list[Path]:
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard", "*.md"],
        cwd=root,
        check=True,
        capture_output=True,
        text=True,
    )
    names = sorted(set(listed.stdout.split("\0")) - {""})
    return [Path(name) for name in names if not name.startswith(LEFT_OUT)]


def _linked(root: Path, page: Path) -> list[Path]:
    """Return the files other than pages that a page links to."""
    found = set()
    for link in LINK.findall((root / page).read_text("utf-8")):
        if ":" in link or link.endswith((".md", "/")):
            continue
        path = (root / page.parent / unquote(link)).resolve()
        if path.is_file():
            found.add(path.relative_to(root.resolve()))
    return sorted(found)


def _copy(root: Path, target: Path, path: Path) -> None:
    (target / path).parent.mkdir(parents=True, exist_ok=True)
    shutil.copy(root / path, target / path)


def _commands() -> str:
    """Return every command with its arguments and options, as ``--help`` has them."""
    parts = ["# Commands and options\n\n[The overview](README.md#commands) has a line for each.\n"]
    for name, app in (("mcserver", mcserver.cli.app.build_app()), ("mcctl", mcclient.cli.app.build_app())):
        command = typer.main.get_command(app)
        parts.append(get_docs_for_click(obj=command, ctx=typer.Context(command), indent=1, name=name))
    return "\n".join(parts)
