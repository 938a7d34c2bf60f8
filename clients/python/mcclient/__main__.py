"""``python -m mcclient`` is ``mcctl``."""

from mcclient.cli import main

main()
