"""What the machine's page says, from states as a server sends them."""

from __future__ import annotations
