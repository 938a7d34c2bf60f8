"""Builds the SDKs whose tools are here, one after the other, so that tests find them built:
``python -m tests.sdks.build``. Any Python from 3.11 on can: it needs no other package.
"""

from __future__ import annotations

import sys
import time

from tests.sdks.cargo import cargo
from tests.sdks.languages import SDKS, ToolMissing


def main() -> int:
    """The exit code: 0 where each is built, or has no tool here."""
    failed = 0
    for name, build in SDKS.items():
        began = time.monotonic()
        try:
            build()
            if name == "rust":
                cargo("test", "--locked", "--lib", "--examples", "--no-run")
        except ToolMissing as missing:
            print(f"{name}: not built, {missing}")
        except AssertionError as error:
            failed = 1
            print(f"{name}: {error}", file=sys.stderr)
        else:
            print(f"{name}: built in {time.monotonic() - began:.0f} s", flush=True)
    return failed


if __name__ == "__main__":
    sys.exit(main())
