"""Write the contract: ``python -m mcserver.contract clients/contract``."""

from __future__ import annotations

import sys
from pathlib import Path

from mcserver.contract.files import write

if __name__ == "__main__":
    write(Path(sys.argv[1]))
