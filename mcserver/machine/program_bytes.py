"""Bytes of a program's file to its text, as older CAM systems write them too."""

from __future__ import annotations


def text_of_bytes(content: bytes) -> str | None:
    """Return the text: UTF-8, or Latin-1 as older CAM systems write comments; code is ASCII in both.

    Returns:
        None for a file of another kind: it has a byte 0, which no text has.
    """
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return None if b"\0" in content else content.decode("cp1252", "replace")
