"""The codes of a machine's profile: those that act, have no effect, or are refused, and what each does."""

from __future__ import annotations

import re
from collections.abc import Collection

from mcserver.gcode.profiles.codes import (
    IGNORED,
    MOTIONS,
    PROBING,
    PROGRAM,
    REFUSED,
    SETTINGS,
    acting_of,
    settings_of,
)
from mcserver.gcode.text.command_table import COMMANDS
from mcserver.language.rules import rules
from mcserver.machine.machine_file import Machine

# Rules that describe a code, the first that name it; those that show it as code go before.
MOST_RULES = 2


def profile_codes(machine: Machine) -> str:
    """List the codes of the machine's profile: those that act, are left alone, and are refused."""
    profile = machine.dialect.profile
    acting = acting_codes(machine)
    ignored = IGNORED[profile] - acting
    refused = {code: why for code, why in REFUSED.items() if code not in acting | ignored}
    parts = [f"Profile {profile} of {machine.name}. Codes that act: {', '.join(in_order(acting))}."]
    if ignored:
        parts.append(f"Without effect, listed once: {', '.join(in_order(ignored))}.")
    if profile != "reference":
        parts += [f"{code}: refused; {refused[code]}" for code in in_order(refused)]
    return "\n\n".join([*parts, "`dialect` tells of each."])


def acting_codes(machine: Machine) -> frozenset[str]:
    """Return the codes that do something on a machine, such as G2."""
    outputs = frozenset({"M62", "M63", "M64", "M65", "M67", "M68"}) if machine.outputs else frozenset[str]()
    inputs = frozenset({"M66"}) if machine.inputs else frozenset[str]()
    probing = frozenset[str]() if machine.probe is None else PROBING
    own = frozenset(spec.name for spec in COMMANDS) if machine.dialect.profile == "reference" else frozenset()
    mapped = machine.dialect.mapped
    acting = acting_of(machine.dialect) | settings_of(machine.dialect.profile)
    return acting | MOTIONS | PROGRAM | outputs | inputs | probing | own | mapped


def in_order(codes: Collection[str]) -> list[str]:
    """Sort codes by letter and number."""
    return sorted(
        codes, key=lambda code: (code[:1], float(code[1:]) if code[1:].replace(".", "").isdigit() else 0.0)
    )


def describe_profile_code(asked: str, machine: Machine) -> str:
    """Tell of a code that the machine's profile adds, with the rules that name it; empty: it adds none."""
    found = re.fullmatch(r"([GM])0*([0-9]+(?:\.[0-9]+)?)", asked.upper())
    if found is None:
        return ""
    code, profile = f"{found[1]}{float(found[2]):g}", machine.dialect.profile
    if profile == "reference" and code in SETTINGS | MOTIONS | PROGRAM:
        return ""
    if code in acting_codes(machine):
        does = f"acts in the profile {profile}"
    elif code in IGNORED[profile]:
        does = f"has no effect in the profile {profile}; `check` lists it once"
    elif code in REFUSED:
        does = f"is refused: {REFUSED[code]}"
    else:
        return ""
    named = [rule for rule in rules().values() if re.search(rf"(?<![A-Z0-9.]){code}(?![0-9.])", rule.text)]
    # where it is said first what a code does, it stands as code
    named.sort(key=lambda rule: re.search(rf"`{code}(?![0-9.])", rule.text) is None)
    return "\n\n".join(
        [
            f"**{code}** {does}.",
            *(f"**{rule.name}** {rule.title}. {rule.text}" for rule in named[:MOST_RULES]),
        ]
    )
