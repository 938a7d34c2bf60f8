"""What is read of a site's folder: its description, and where its configurations are."""

from __future__ import annotations

from pathlib import Path

import msgspec

from mcserver.errors import ConfigurationError
from mcserver.security.site import Site

SITE_FILE = "site.json"
ROUTER = "router"


def read_site(folder: Path) -> Site:
    """Return the site that a folder describes.

    Raises:
        ConfigurationError: MC560 it describes none.
    """
    try:
        return msgspec.json.decode((folder / SITE_FILE).read_bytes(), type=Site)
    except (OSError, msgspec.DecodeError) as error:
        raise ConfigurationError(
            "MC560", f"{folder} describes no site: {error}", "make one: mcserver security init"
        ) from error


def configuration_path(folder: Path, identity: str) -> Path:
    """Zenoh's configuration for the router, a machine (``machine.NAME``) or a user."""
    return folder / f"{identity}.json5"
