"""EDS texts of drives as makers write them, made for the tests."""

from __future__ import annotations

from collections.abc import Sequence

U8, U16, U32, I8, I16, I32 = 5, 6, 7, 2, 3, 4
INVALID = 0x8000_0000
# index, name, type, access, default, mappable
_COMMON = (
    (0x1000, "Device type", U32, "ro", "0x00020192", 0),
    (0x1001, "Error register", U8, "ro", "0", 0),
    (0x1005, "COB-ID SYNC", U32, "rw", "0x80", 0),
    (0x1014, "COB-ID EMCY", U32, "rw", "$NODEID+0x80", 0),
    (0x1017, "Producer heartbeat time", U16, "rw", "0", 0),
    (0x6040, "Controlword", U16, "rww", "0", 1),
    (0x6041, "Statusword", U16, "ro", "0x40", 1),
    (0x6060, "Modes of operation", I8, "rww", "0", 1),
    (0x6061, "Modes of operation display", I8, "ro", "0", 1),
    (0x6064, "Position actual value", I32, "ro", "0", 1),
    (0x607A, "Target position", I32, "rww", "0", 1),
    (0x60FF, "Target velocity", I32, "rww", "0", 1),
    (0x6098, "Homing method", I8, "rw", "0", 0),
    (0x609A, "Homing acceleration", U32, "rw", "0", 0),
    (0x607C, "Home offset", I32, "rw", "0", 0),
    (0x6079, "DC link voltage", U32, "ro", "48000", 1),
    (0x6502, "Supported drive modes", U32, "ro", "0x3ED", 0),
)
# The default mapping of CiA 402: one object after the other.
CIA_402_RPDOS = ((0x60400010,), (0x60400010, 0x60600008), (0x60400010, 0x607A0020), (0x60400010, 0x60FF0020))
CIA_402_TPDOS = ((0x60410010,), (0x60410010, 0x60610008), (0x60410010, 0x60640020), (0x60410010,))


def eds(
    without: Sequence[int] = (),
    changes: dict[int, dict[str, str]] | None = None,
    *,
    fixed: bool = False,
    cob_access: str = "rw",
    rpdos: Sequence[Sequence[int]] = CIA_402_RPDOS,
    tpdos: Sequence[Sequence[int]] = CIA_402_TPDOS,
    more: str = "",
    axes: int = 1,
    transmission: str = "1",
    rpdo_members: int = 5,
    off: bool = False,
) -> str:
    """A drive's EDS; ``changes``: keys of an object's section; ``fixed``: mappings cannot be written.

    ``rpdo_members``: of the records of RPDOs; with 2 they have no time-out. ``off``: PDOs are invalid.
    """
    off_bit = INVALID if off else 0
    parts = []
    for axis in range(axes):
        for index, name, kind, access, default, mappable in _COMMON:
            if axis and index < 0x6000:
                continue
            index += 0x800 * axis
            if index in without:
                continue
            keys = {
                "ParameterName": name,
                "ObjectType": "0x7",
                "DataType": f"0x{kind:04X}",
                "AccessType": access,
                "DefaultValue": default,
                "PDOMapping": str(mappable),
                **(changes or {}).get(index, {}),
            }
            parts.append(f"[{index:04X}]\n" + "".join(f"{key}={value}\n" for key, value in keys.items()))
        parts += (
            [record(0x1018, "Identity", (U32,) * 4, "ro", ["0x11", "0x22", "1", "5"])] if not axis else []
        )
        parts.append(record(0x6099 + 0x800 * axis, "Homing speeds", (U32, U32), "rw", ["0", "0"]))
        first = 64 * axis
        for number, mapped in enumerate(rpdos):
            cob = f"$NODEID+0x{off_bit + 0x200 + 0x100 * number:X}"
            parts += _pdo(
                0x1400 + first + number,
                0x1600 + first + number,
                [cob, transmission, "0", "0", "0"][:rpdo_members],
                mapped,
                fixed,
                cob_access,
                axis,
            )
        for number, mapped in enumerate(tpdos):
            cob = f"$NODEID+0x{off_bit + 0x180 + 0x100 * number:X}"
            parts += _pdo(
                0x1800 + first + number,
                0x1A00 + first + number,
                [cob, transmission, "0", "0", "0"],
                mapped,
                fixed,
                cob_access,
                axis,
            )
    return "\n".join(part for part in parts if part) + more


def entry(
    index: int, name: str, kind: int, *, access: str = "rw", mapped: bool = True, default: str = "0"
) -> str:
    """One object that is no record."""
    return (
        f"[{index:04X}]\nParameterName={name}\nObjectType=0x7\nDataType=0x{kind:04X}\nAccessType={access}\n"
        f"DefaultValue={default}\nPDOMapping={int(mapped)}\n"
    )


def _pdo(
    communication: int,
    mapping: int,
    defaults: Sequence[str],
    mapped: Sequence[int],
    fixed: bool,
    cob_access: str,
    axis: int,
) -> list[str]:
    offset = axis * 0x800 << 16
    words = [f"0x{word + offset:08X}" for word in mapped]
    words += ["0"] * (8 - len(words))
    access = "const" if fixed else "rw"
    return [
        record(
            communication, "PDO", (U32, U8, U16, U8, U16)[: len(defaults)], "rw", defaults, {1: cob_access}
        ),
        record(mapping, "Mapping", (U32,) * 8, access, words, {0: access}, count=len(mapped)),
    ]


def record(
    index: int,
    name: str,
    kinds: Sequence[int],
    access: str,
    defaults: Sequence[str],
    special: dict[int, str] | None = None,
    count: int | None = None,
    mapped: bool = False,
) -> str:
    """A record with a member for each kind; ``special``: access of single ones."""
    special = special or {}
    text = f"[{index:04X}]\nParameterName={name}\nObjectType=0x9\n"
    text += f"[{index:04X}sub0]\nParameterName=Count\nDataType=0x0005\nAccessType={special.get(0, 'ro')}\n"
    text += f"DefaultValue={len(kinds) if count is None else count}\n"
    for at, (kind, default) in enumerate(zip(kinds, defaults, strict=True), 1):
        text += f"[{index:04X}sub{at:X}]\nParameterName={name} {at}\nDataType=0x{kind:04X}\n"
        text += f"AccessType={special.get(at, access)}\nDefaultValue={default}\nPDOMapping={int(mapped)}\n"
    return text
