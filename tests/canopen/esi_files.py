"""An ESI file of a CiA 402 drive as makers write them: types of its own, values as bytes, PDOs, modes."""

from __future__ import annotations

VENDOR, PRODUCT = 0x539, 0x402E
_RECORDS = ((0x6091, "Gear ratio", ("Motor revolutions", "Shaft revolutions"), ("01000000", "05000000")),)
# index, name, type, access, PdoMapping, DefaultData
_VARIABLES = (
    (0x1000, "Device type", "UDINT", "ro", "", "92010200"),
    (0x1008, "Device name", "STRING(9)", "ro", "", ""),
    (0x2001, "Brake delay", "UINT", "rw", "", "0700"),
    (0x603F, "Error code", "UINT", "ro", "T", "0000"),
    (0x6040, "Controlword", "UINT", "rw", "R", "0000"),
    (0x6041, "Statusword", "UINT", "ro", "T", "0000"),
    (0x6060, "Modes of operation", "SINT", "rw", "R", "FF"),
    (0x6061, "Modes of operation display", "DT_MODE", "ro", "T", "08"),
    (0x6064, "Position actual value", "DINT", "ro", "T", ""),
    (0x6065, "Following error window", "UDINT", "rw", "", "E8030000"),
    (0x607A, "Target position", "DINT", "rw", "R", ""),
    (0x60FF, "Target velocity", "DINT", "rw", "", ""),
    (0x6502, "Supported drive modes", "UDINT", "ro", "", "A0030000"),
)
_TYPES = (
    "<DataType><Name>DT_MODE</Name><BaseType>SINT</BaseType><BitSize>8</BitSize></DataType>"
    "<DataType><Name>DT6091ARR</Name><BaseType>UDINT</BaseType><BitSize>64</BitSize>"
    "<ArrayInfo><LBound>1</LBound><Elements>2</Elements></ArrayInfo></DataType>"
    "<DataType><Name>DT6091</Name><BitSize>80</BitSize>"
    "<SubItem><SubIdx>0</SubIdx><Name>SubIndex 000</Name><Type>USINT</Type><BitSize>8</BitSize>"
    "<Flags><Access>ro</Access></Flags></SubItem>"
    "<SubItem><Name>Elements</Name><Type>DT6091ARR</Type><BitSize>64</BitSize>"
    "<Flags><Access>rw</Access></Flags></SubItem></DataType>"
)


def _objects() -> str:
    text = "".join(
        f"<Object><Index>#x{index:04X}</Index><Name LcId='1031'>deutsch</Name><Name LcId='1033'>{name}</Name>"
        f"<Type>{kind}</Type><Info><DefaultData>{default}</DefaultData></Info>"
        f"<Flags><Access>{access}</Access><PdoMapping>{mapped}</PdoMapping></Flags></Object>"
        for index, name, kind, access, mapped, default in _VARIABLES
    )
    for index, name, _, defaults in _RECORDS:
        values = "".join(
            f"<SubItem><Name>m</Name><Info><DefaultData>{each}</DefaultData></Info></SubItem>"
            for each in ("02", *defaults)
        )
        text += f"<Object><Index>#x{index:04x}</Index><Name>{name}</Name><Type>DT{index:04X}</Type>"
        text += f"<Info>{values}</Info></Object>"
    return text


def pdo(tag: str, index: int, *entries: tuple[int, int], fixed: bool) -> str:
    """One PDO of (index, bits)."""
    listed = "".join(
        f"<Entry><Index>#x{each:04X}</Index><SubIndex>0</SubIndex><BitLen>{bits}</BitLen></Entry>"
        for each, bits in entries
    )
    return f'<{tag} Fixed="{int(fixed)}"><Index>#x{index:04X}</Index>{listed}</{tag}>'


FIXED_OUTPUTS = pdo("RxPdo", 0x1600, (0x6040, 16), (0x607A, 32), fixed=True)
OUTPUTS = pdo("RxPdo", 0x1601, (0x6040, 16), (0x60FF, 32), fixed=False)
INPUTS = pdo("TxPdo", 0x1A00, (0x6041, 16), (0x6064, 32), fixed=False)
SYNC0 = "<Dc><OpMode><Name>DC</Name><AssignActivate>#x300</AssignActivate></OpMode></Dc>"


def device(
    product: int = PRODUCT,
    revision: int = 1,
    *,
    objects: str | None = None,
    pdos: str = FIXED_OUTPUTS + OUTPUTS + INPUTS,
    clock: str = SYNC0,
) -> str:
    """One device of a file."""
    listed = _objects() if objects is None else objects
    dictionary = f"<Dictionary><DataTypes>{_TYPES}</DataTypes><Objects>{listed}</Objects></Dictionary>"
    return (
        f'<Device><Type ProductCode="#x{product:08X}" RevisionNo="#x{revision:08X}">Drive {revision}</Type>'
        f"<Name>A drive</Name><Profile><ProfileNo>402</ProfileNo>{dictionary if listed else ''}</Profile>"
        f"{pdos}{clock}</Device>"
    )


def esi(*devices: str, head: str = '<?xml version="1.0"?>') -> str:
    """A file of these devices; none named: one drive."""
    listed = "".join(devices or (device(),))
    return (
        f"{head}<EtherCATInfo><Vendor><Id>#x{VENDOR:X}</Id><Name>Maker</Name></Vendor>"
        f"<Descriptions><Devices>{listed}</Devices></Descriptions></EtherCATInfo>"
    )
