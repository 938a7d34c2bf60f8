"""Build the site into ``out/site``: ``make docs``; with ``--serve`` show it while pages are written."""

from __future__ import annotations

import sys
from pathlib import Path

from mkdocs.__main__ import cli

from deploy.site.source import write_source

OUT = Path("out")


def main() -> None:
    """Write the source of the site, then have MkDocs build it; every broken link ends it."""
    source = OUT / "site-source"
    write_source(Path(), source)
    config = ["--config-file", str(source / "mkdocs.yml"), "--strict"]
    if "--serve" in sys.argv[1:]:
        cli(["serve", *config])
    cli(["build", *config, "--clean", "--site-dir", str((OUT / "site").resolve())])


if __name__ == "__main__":
    main()
