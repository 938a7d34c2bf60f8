"""``python -m mcserver``: the same as the command ``mcserver``."""

from mcserver.cli.app import main

if __name__ == "__main__":
    main()
