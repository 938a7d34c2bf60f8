"""Write the SDKs' types and calls: ``python -m mcserver.contract.sdk clients``."""

from __future__ import annotations

import sys
from pathlib import Path

from mcserver.contract.sdk.files import write

if __name__ == "__main__":
    write(Path(sys.argv[1]))
