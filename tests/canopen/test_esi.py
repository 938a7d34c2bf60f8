"""ESI files: objects, the device that is meant, what is refused."""

from __future__ import annotations

from pathlib import Path

import pytest
from canopen.objectdictionary import datatypes

from mcserver.canopen.coe import configure_coe
from mcserver.canopen.description import describe
from mcserver.canopen.dictionary import DeviceDictionary
from mcserver.canopen.machine_file_check import check_drives
from mcserver.canopen.parameters import find, parameters_of
from mcserver.canopen.settings import DriveSettings
from mcserver.errors import ConfigurationError
from mcserver.machine.machine_file import parse_machine
from tests.canopen.esi_files import FIXED_OUTPUTS, INPUTS, OUTPUTS, PRODUCT, device, esi, pdo
from tests.ethercat.rig import line_of


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "drive.xml"


def drive_of(file: Path, **keys: int) -> DriveSettings:
    return DriveSettings(
        0, "cia402", "line", "ec0", 1, eds=str(file), fieldbus="ethercat", distributed_clocks=True, **keys
    )


def read(file: Path, text: str | bytes, **keys: int) -> DeviceDictionary:
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    return describe(drive_of(file, **keys)).dictionary


def refusal(file: Path, text: str | bytes, **keys: int) -> ConfigurationError:
    with pytest.raises(ConfigurationError) as refused:
        read(file, text, **keys)
    assert refused.value.hint
    return refused.value


def test_an_object_has_its_english_name_type_access_and_value(file: Path) -> None:
    found = read(file, esi())
    window, mode, shown = (found.get_variable(index) for index in (0x6065, 0x6060, 0x6061))
    assert window is not None
    assert mode is not None
    assert shown is not None
    assert (window.name, window.access_type, window.default) == ("Following error window", "rw", 1000)
    assert (mode.data_type, mode.default, mode.pdo_mappable) == (datatypes.INTEGER8, -1, True)
    # by the name of a type of the file's own
    assert shown.data_type == datatypes.INTEGER8
    assert not window.pdo_mappable


def test_an_array_gives_its_members_with_their_values(file: Path) -> None:
    members = [read(file, esi()).get_variable(0x6091, subindex) for subindex in (0, 1, 2)]
    assert [each and (each.data_type, each.default) for each in members] == [
        (datatypes.UNSIGNED8, 2),
        (datatypes.UNSIGNED32, 1),
        (datatypes.UNSIGNED32, 5),
    ]


def test_a_parameter_is_found_by_the_name_that_the_file_gives(file: Path) -> None:
    dictionary = read(file, esi())
    found = find(parameters_of(dictionary), dictionary, "following error window")
    assert found.title == "6065h:00 Following error window"


def test_what_a_pdo_carries_can_be_mapped_whatever_its_object_says(file: Path) -> None:
    velocity = read(file, esi()).get_variable(0x60FF)
    assert velocity is not None
    assert velocity.pdo_mappable


def test_process_data_are_mapped_into_the_first_pdos_that_are_not_fixed(file: Path) -> None:
    file.write_text(esi())
    writes, _ = configure_coe(drive_of(file), 0.001)
    assigned = {write.index: write.payload for write in writes if write.what.startswith("assignment of 1")}
    assert assigned == {0x1C12: b"\x01\x16", 0x1C13: b"\x00\x1a"}
    assert {write.index for write in writes} >= {0x1601, 0x1A00, 0x1C32}
    assert 0x1600 not in {write.index for write in writes}


def test_the_fewest_fixed_pdos_that_carry_what_is_needed_are_assigned(file: Path) -> None:
    both = pdo("RxPdo", 0x1602, (0x6040, 16), (0x607A, 32), (0, 16), fixed=True)
    single = pdo("RxPdo", 0x1600, (0x6040, 16), fixed=True) + pdo("RxPdo", 0x1601, (0x607A, 32), fixed=True)
    mode = pdo("RxPdo", 0x1603, (0x6060, 8), (0, 8), fixed=True)
    file.write_text(esi(device(pdos=single + both + mode + INPUTS)))
    writes, planned = configure_coe(drive_of(file), 0.001)
    assigned = [write.payload for write in writes if write.index == 0x1C12]
    assert assigned == [b"\x00", b"\x02\x16", b"\x03\x16", b"\x02"]
    (outputs,) = planned.process_data.rpdos
    assert [each.index for each in outputs.objects] == [0x6040, 0x607A, 0, 0x6060, 0]
    assert outputs.length == 10
    assert not {write.index for write in writes} & {0x1600, 0x1601, 0x1602, 0x1603}
    without = both.replace("</RxPdo>", "<Exclude>#x1603</Exclude></RxPdo>")
    file.write_text(esi(device(pdos=without + mode + INPUTS)))
    _, planned = configure_coe(drive_of(file), 0.001)
    assert planned.process_data.rpdos[0].length == 8


def test_a_drive_without_a_mode_of_sync0_alone_is_not_clocked(file: Path) -> None:
    both = "<Dc><OpMode><AssignActivate>#x0730</AssignActivate></OpMode></Dc>"
    file.write_text(esi(device(clock=both)))
    writes, _ = configure_coe(drive_of(file), 0.001)
    assert 0x1C32 not in {write.index for write in writes}


def test_the_newest_revision_of_a_product_counts(file: Path) -> None:
    found = read(file, esi(device(revision=0x10002), device(revision=0x20001), device(revision=3)))
    assert found.coe.revision == 0x20001


def test_of_several_products_the_machine_file_names_one(file: Path) -> None:
    text = esi(device(1), device(2))
    error = refusal(file, text)
    assert (error.code, "0x00000001 Drive 1, 0x00000002" in error.message) == ("MC036", True)
    assert read(file, text, product_code=2).coe.product_code == 2
    assert refusal(file, text, product_code=3).code == "MC036"
    assert refusal(file, text, product_code=2, vendor_id=7).code == "MC036"


def test_values_that_make_no_sense_are_named_and_left_out(file: Path) -> None:
    file.write_text(
        esi().replace("E8030000", "E80300000001").replace("#x60FF</Index><Name L", "no</Index><Name L")
    )
    described = describe(drive_of(file))
    window = described.dictionary.get_variable(0x6065)
    assert window is not None
    assert window.default is None
    assert [each.split(" (")[0] for each in described.ignored] == [
        "DefaultData of 6065h:00",
        "an object with the index 'no'",
    ]


BOMB = (
    '<?xml version="1.0"?><!DOCTYPE x [<!ENTITY a "aaaaaaaaaa">'
    + "".join(f'<!ENTITY {new} "{f"&{old};" * 10}">' for old, new in zip("abcdefgh", "bcdefghi", strict=True))
    + "]>"
)
OF_OTHERS = '<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]>'
REFUSED = {
    "entities": esi(head=BOMB).replace("A drive", "&i;"),
    "a file of others": esi(head=OF_OTHERS).replace("A drive", "&a;"),
    "cut off": esi()[:-20],
    "bytes that are not of its encoding": esi().replace("A drive", "\xfc").encode("latin-1"),
    "an encoding that nobody knows": esi(head='<?xml version="1.0" encoding="x-none"?>'),
    "half of UTF-16": esi().encode("utf-16")[:-7],
    "XML of another kind": "<html/>",
    "no device": esi().replace("ProductCode", "Product"),
    "nothing but a mark": b"\xff\xfe<",
    "too deep to end": "<EtherCATInfo>" + "<a>" * 100_000,
}


@pytest.mark.parametrize("text", REFUSED.values(), ids=list(REFUSED))
def test_what_is_no_sound_esi_file_is_refused_by_its_name(file: Path, text: str | bytes) -> None:
    error = refusal(file, text)
    assert (error.code, "drive.xml" in error.message) == ("MC008", True)


def test_a_file_that_is_too_large_is_not_read(file: Path) -> None:
    with file.open("wb") as made:
        made.truncate(64 * 1024 * 1024)
    with pytest.raises(ConfigurationError, match=r"MC008.*more than"):
        describe(drive_of(file))


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_a_file_in_another_unicode_is_read(file: Path, encoding: str) -> None:
    assert read(file, esi(head="").encode(encoding)).coe.product_code == PRODUCT


def checked(file: Path, text: str, keys: str = "") -> list[tuple[str, str]]:
    file.write_text(text)
    machine = parse_machine(line_of(1, drive=f'eds = "{file}"\n{keys}'))
    return [(found.code, found.message) for found in check_drives(machine)]


def test_a_sound_drive_is_beyond_doubt(file: Path) -> None:
    assert checked(file, esi()) == []


@pytest.mark.parametrize(
    ("made", "code", "said"),
    [
        (device(objects=""), "MC022", "lists no objects"),
        (device(clock=""), "MC022", "no mode with SYNC0 alone"),
        (device(pdos=OUTPUTS), "", ""),
        (device(pdos=FIXED_OUTPUTS + INPUTS), "", ""),
        (device(pdos=pdo("RxPdo", 0x1600, (0x6040, 16), fixed=True)), "MC552", "607Ah:00"),
        (device(pdos=OUTPUTS + pdo("TxPdo", 0x1A00, (0x6041, 16), fixed=True)), "MC552", "6064h:00"),
        (device(pdos=pdo("RxPdo", 0x1600, (0x6040, 16), (0x2001, 16), fixed=True)), "MC552", "6040h:00"),
        (device(pdos=pdo("RxPdo", 0x1600, (0x6040, 16), (0, 1), fixed=True)), "MC552", "1600h:00"),
        (device(objects="<Object><Index>#x1000</Index><Type>UDINT</Type></Object>"), "MC552", "6040h:00"),
    ],
)
def test_machine_check_says_what_the_file_leaves_open_or_rules_out(
    file: Path, made: str, code: str, said: str
) -> None:
    found = checked(file, esi(made))
    assert [each[0] for each in found] == ([code] if code else [])
    assert all(said in message for _, message in found)


def test_an_esi_file_is_no_description_of_a_drive_on_can(file: Path) -> None:
    file.write_text(esi())
    drive = DriveSettings(0, "cia402", "can", "can0", 1, eds=str(file))
    with pytest.raises(ConfigurationError, match="MC036"):
        describe(drive)
