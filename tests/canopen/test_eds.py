"""EDS and DCF files as the world writes them."""

from __future__ import annotations

from pathlib import Path

import canopen
import pytest
from canopen.objectdictionary import ObjectDictionary, ODArray, ODRecord, ODVariable
from hypothesis import given
from hypothesis import strategies as st

from mcserver.canopen.description import describe
from mcserver.canopen.dictionary import DeviceDictionary
from mcserver.canopen.eds import parse_description
from mcserver.canopen.sdo_write import DriveDictionary
from mcserver.canopen.settings import DriveSettings
from mcserver.errors import ConfigurationError

NODE = 5

PLAIN = """\
[DeviceInfo]
VendorName=Maker

[1000]
ParameterName=Device type
ObjectType=0x7
DataType=0x0007
AccessType=ro
DefaultValue=0x00020192

[6064]
ParameterName=Position actual value
DataType=0x0004
AccessType=ro
PDOMapping=1
"""


def dictionary(text: str, node: int = NODE) -> ObjectDictionary:
    return parse_description(text, node).dictionary


def dictionary_of_file(path: Path) -> DeviceDictionary:
    return describe(DriveSettings(0, "cia402", "can", "can0", NODE, eds=str(path))).dictionary


def variable(text: str, index: int, subindex: int = 0) -> ODVariable:
    found = dictionary(text).get_variable(index, subindex)
    assert found is not None
    return found


def refusal(text: str) -> ConfigurationError:
    with pytest.raises(ConfigurationError) as found:
        parse_description(text, NODE, "drive.eds")
    assert found.value.code == "MC008"
    assert found.value.hint
    return found.value


def test_a_plain_file_gives_its_objects() -> None:
    found = variable(PLAIN, 0x1000)
    assert (found.name, found.default, found.access_type, found.writable) == (
        "Device type",
        0x20192,
        "ro",
        False,
    )
    assert variable(PLAIN, 0x6064).pdo_mappable


def test_bytes_of_windows_1252_are_read(tmp_path: Path) -> None:
    path = tmp_path / "drive.eds"
    path.write_bytes(PLAIN.replace("Position actual", "Größe für Lage, °").encode("cp1252"))
    found = dictionary_of_file(path).get_variable(0x6064)
    assert found is not None
    assert found.name == "Größe für Lage, ° value"


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_unicode_is_read_with_and_without_a_mark(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "drive.eds"
    path.write_bytes(PLAIN.replace("Position", "Größe").replace("\n", "\r\n").encode(encoding))
    found = dictionary_of_file(path).get_variable(0x6064)
    assert found is not None
    assert found.name == "Größe actual value"


def test_comments_behind_values_are_left_out() -> None:
    text = PLAIN.replace("0x00020192", "0x00020192 ; servo drive").replace(
        "DataType=0x0004", "DataType=0x0004;INTEGER32"
    )
    assert variable(text, 0x1000).default == 0x20192
    assert variable(text, 0x6064).data_type == 4


def test_a_semicolon_inside_a_name_is_no_comment() -> None:
    assert variable(PLAIN.replace("Device type", "Type;version"), 0x1000).name == "Type;version"
    assert variable(PLAIN.replace("Device type", "Type ; see manual"), 0x1000).name == "Type"


def test_empty_numbers_are_no_numbers() -> None:
    found = variable(PLAIN + "LowLimit=\nHighLimit= \nDefaultValue=;none\n", 0x6064)
    assert (found.min, found.max, found.default) == (None, None, None)


def test_keys_and_sections_may_have_any_case_and_blanks() -> None:
    text = PLAIN.replace("DataType", "DATATYPE").replace("[6064]", "[ 6064 ]").replace("=", " = ")
    assert variable(text.replace("AccessType = ro", "accesstype = RO"), 0x6064).access_type == "ro"
    record = "[1a00]\nObjectType=9\nParameterName=Map\n[1A00SUB0]\nParameterName=n\nDataType=5\n"
    assert variable(record, 0x1A00, 0).data_type == 5


def test_a_file_without_any_optional_section_is_read() -> None:
    assert list(dictionary(PLAIN[PLAIN.index("[1000]") :])) == [0x1000, 0x6064]


@pytest.mark.parametrize("written", ["$NODEID+0x200", "0x200+$NODEID", "$NodeID + 0x200", "512 + $NODEID"])
def test_node_expressions_are_worked_out(written: str) -> None:
    text = (
        "[1400]\nObjectType=9\nParameterName=RPDO1\n"
        f"[1400sub1]\nParameterName=COB-ID\nDataType=7\nDefaultValue={written}\n"
    )
    found = variable(text, 0x1400, 1)
    assert found.default == 0x205
    assert found.relative


def test_the_first_of_two_equal_keys_and_sections_counts() -> None:
    found = variable(PLAIN.replace("AccessType=ro\nDefault", "AccessType=ro\naccesstype=rw\nDefault"), 0x1000)
    assert found.access_type == "ro"
    twice = PLAIN + "[6064]\nParameterName=Another\nDefaultValue=7\n"
    assert variable(twice, 0x6064).name == "Position actual value"


def test_negative_limits_may_be_written_as_their_bits() -> None:
    found = variable(PLAIN + "LowLimit=0x80000000\nHighLimit=0x7FFFFFFF\n", 0x6064)
    assert (found.min, found.max) == (-(2**31), 2**31 - 1)


def test_octal_and_leading_zeros_are_numbers() -> None:
    assert variable(PLAIN + "DefaultValue=010\n", 0x6064).default == 8
    assert variable(PLAIN + "DefaultValue=089\n", 0x6064).default == 89


def test_values_of_a_dcf_are_kept_beside_the_defaults() -> None:
    text = PLAIN + "DefaultValue=1\nParameterValue=-3\n[DeviceComissioning]\nNodeID=0x07\n"
    described = parse_description(text, NODE)
    found = described.dictionary.get_variable(0x6064)
    assert found is not None
    assert (found.default, found.value) == (1, -3)
    assert described.commissioned_node == 7


def test_compact_records_have_all_their_members() -> None:
    text = (
        "[1003]\nParameterName=Errors\nObjectType=8\nDataType=7\nAccessType=ro\nCompactSubObj=3\n"
        "[1003Name]\nNrOfEntries=1\n2=Second\n[1003Value]\nNrOfEntries=1\n3=0x10\n"
    )
    found = dictionary(text)[0x1003]
    assert isinstance(found, ODArray)
    assert [found[at].name for at in (1, 2, 3)] == ["Errors_1", "Second", "Errors_3"]
    assert found[3].value == 16
    assert found[0].default == 3


def test_members_without_their_record_make_one() -> None:
    text = PLAIN + "[1018sub1]\nParameterName=Vendor\nDataType=7\n"
    assert isinstance(dictionary(text)[0x1018], ODRecord)


def test_own_types_stand_for_what_they_say() -> None:
    text = PLAIN.replace("DataType=0x0004", "DataType=0x00A0") + "[A0sub1]\nDefaultValue=0x4\n"
    assert variable(text, 0x6064).data_type == 4


def test_a_byte_order_mark_inside_prose_and_stray_words_there_do_no_harm() -> None:
    assert 0x1000 in dictionary("[Comments]\nLines=1\nLine1=a = b ; c\nand more\n" + PLAIN)


@pytest.mark.parametrize(
    ("text", "place"),
    [
        (PLAIN.replace("[6064]", "[6064"), "line 11"),
        (PLAIN + "stray words\n", "[6064]: line 16"),
        ("x=1\n" + PLAIN, "line 1"),
        (PLAIN + "ParameterValue=much\n", "[6064], ParameterValue"),
        ("[DeviceInfo]\n", "holds no object"),
        ("", "holds no object"),
    ],
)
def test_what_cannot_be_meant_is_refused_with_its_place(text: str, place: str) -> None:
    error = refusal(text)
    assert "drive.eds" in error.message
    assert place in error.message


@pytest.mark.parametrize(
    ("text", "index", "place"),
    [
        (PLAIN.replace("DataType=0x0004", "DataType=four"), 0x6064, "[6064], DataType"),
        (PLAIN.replace("DataType=0x0004\n", ""), 0x6064, "[6064], DataType"),
        (PLAIN.replace("0x00020192", "0x1FFFFFFFF"), 0x1000, "[1000], DefaultValue"),
        (PLAIN.replace("AccessType=ro\nPDO", "AccessType=maybe\nPDO"), 0x6064, "[6064], AccessType"),
    ],
)
def test_an_object_that_cannot_be_read_is_refused_by_whoever_uses_it(
    text: str, index: int, place: str
) -> None:
    found = parse_description(text, NODE, "drive.eds").dictionary
    known = DriveDictionary(DriveSettings(0, "cia402", "left", "can0", NODE), found)
    with pytest.raises(ConfigurationError, match=r"drive[.]eds") as error:
        known.variable(index)
    assert error.value.code == "MC008"
    assert place in error.value.message
    assert known.variable(0x6064 if index == 0x1000 else 0x1000) is not None


def test_limits_and_stray_members_that_make_no_sense_are_named_and_not_used() -> None:
    text = PLAIN + "LowLimit=0\nHighLimit=0x100000000\n[1000sub0]\nDataType=5\n"
    described = parse_description(text, NODE)
    found = described.dictionary.get_variable(0x6064)
    assert found is not None
    assert (found.min, found.max) == (0, None)
    assert described.ignored == (
        "[6064] HighLimit is no value of its type",
        "[1000sub0] is a member of a variable",
    )


@pytest.mark.parametrize(
    ("written", "value"), [("0x00000000", 0.0), ("0x3FC00000", 1.5), ("1,5", 1.5), ("2", 2.0)]
)
def test_real_numbers_are_read_from_their_bits_too(written: str, value: float) -> None:
    text = PLAIN + f"[2000]\nParameterName=Gain\nDataType=8\nAccessType=rw\nDefaultValue={written}\n"
    assert variable(text, 0x2000).default == value


ODD = ("-", "0x", "$NODEID", "--1", "1e9", "9" * 30, "-0x80000000")


@given(st.data())
def test_whatever_a_file_holds_it_is_read_or_refused_with_mc008(data: st.DataObject) -> None:
    more = "[1400]\nObjectType=9\n[1400sub1]\nDataType=7\nDefaultValue=$NODEID+0x200\n"
    lines = (PLAIN + more).split("\n")
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(lines) - 1))
        key = lines[at].partition("=")[0]
        head = data.draw(st.sampled_from(["", f"{key}=", f"[{key}]"]))
        lines[at] = head + data.draw(st.text(max_size=12) | st.sampled_from(ODD))
    codes = []
    try:
        found = parse_description("\n".join(lines), NODE).dictionary
        codes += ["read"] * (len(found) + len(found.unreadable) > 0)
    except ConfigurationError as error:
        codes.append(error.code)
    assert codes in (["read"], ["MC008"])


def test_a_missing_file_is_refused_with_its_name(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"MC008.*none\.eds.*cannot be read"):
        dictionary_of_file(tmp_path / "none.eds")


def test_the_simulated_drive_s_own_file_is_read_as_canopen_reads_it() -> None:
    path = Path(__file__).parents[2] / "mcserver" / "drive_sim" / "cia402.eds"
    ours = dictionary_of_file(path)
    theirs = canopen.import_od(str(path), NODE)
    assert len(ours) > 50
    for index in ours:
        entry = theirs[index]
        for found in [ours[index]] if isinstance(entry, ODVariable) else ours[index].values():
            other = theirs.get_variable(index, found.subindex)
            assert other is not None
            assert (found.data_type, found.access_type) == (other.data_type, other.access_type), hex(index)
            if isinstance(other.default, int):
                # canopen leaves negative defaults as the number that their bits make
                assert isinstance(found.default, int)
                assert (found.default - other.default) % (1 << len(found)) == 0, hex(index)
            else:
                assert found.default == other.default, hex(index)
