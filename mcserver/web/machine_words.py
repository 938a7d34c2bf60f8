"""Words that come from the motion server in English, and that the page says in its reader's language."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from mcserver.web.translation import mark, t

# how an axis finds its reference
HOMING_METHODS: Mapping[str, str] = MappingProxyType(
    {
        "switch": mark("by a switch"),
        "index": mark("by the index"),
        "hard-stop": mark("at a stop"),
        "absolute": mark("absolute encoder"),
        "drive": mark("by the drive"),
        "manual": mark("by hand"),
    }
)
HOMING_PHASES = (
    mark("off the switch, the search begins"),
    mark("the switch is active: off it first"),
    mark("searching"),
    mark("found, backing off"),
    mark("slowly to it again"),
    mark("on to the index"),
    mark("found, coming to rest"),
    mark("homed, going to its place"),
    mark("the drive homes itself"),
    mark("the drive is at home"),
    mark("done"),
)
PROBING_CYCLES = (
    mark("Probing"),
    mark("Edge X, going +"),
    mark("Edge X, going −"),
    mark("Edge Y, going +"),
    mark("Edge Y, going −"),
    mark("Top"),
    mark("Corner left front"),
    mark("Corner left back"),
    mark("Corner right front"),
    mark("Corner right back"),
    mark("Centre of a hole"),
    mark("Centre of a boss"),
    mark("Tool length"),
)
PROBING_NUMBERS = (
    mark("travel"),
    mark("feed"),
    mark("slow"),
    mark("back"),
    mark("diameter"),
    mark("width"),
    mark("clear"),
    mark("inset"),
    mark("depth"),
    mark("thickness"),
    mark("setter"),
)
# what the page and the server call programs that are no files
PROGRAM_NAMES = (
    mark("energize"),
    mark("manual input"),
    mark("work offset"),
    mark("text of the fleet's page"),
)


def program_name(name: str) -> str:
    """Return what a program is called in the language of the page, where it is no file's or person's name."""
    if name in PROGRAM_NAMES:
        return t(name)
    what, _, user = name.rpartition(" by ")
    if what in PROGRAM_NAMES or what in PROBING_CYCLES:
        return f"{t(what)} {t('by {name}', name=user)}"
    return name
