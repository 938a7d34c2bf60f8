"""Keys, tokens and attachments of rmw_zenoh."""

from __future__ import annotations

import pytest
import zenoh
import zenoh.ext

from mcserver.ros.graph import Attachment, Entity, Kind, NodeName, Qos, gid_of, read_attachment, ros_name

SESSION = "aac3178e146ba6f1fc6e6a4085e77f21"
HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
NODE = NodeName(2, SESSION, 0, "", "listener")
CHATTER = Entity(Kind.SUBSCRIPTION, "/chatter", "std_msgs/msg/String", HASH)


def test_tokens_and_keys_are_those_of_the_design_page() -> None:
    assert NODE.token() == f"@ros2_lv/2/{SESSION}/0/0/NN/%/%/listener"
    assert NODE.token_of(CHATTER, 10) == (
        f"@ros2_lv/2/{SESSION}/0/10/MS/%/%/listener/%chatter/std_msgs::msg::dds_::String_/{HASH}/::,10:,:,:,,"
    )
    assert NODE.key_of(CHATTER) == f"2/chatter/std_msgs::msg::dds_::String_/{HASH}"


def test_names_below_a_namespace_keep_their_slashes_in_keys_alone() -> None:
    node = NodeName(0, SESSION, 3, "/cell/a", "bridge")
    entity = Entity(Kind.PUBLISHER, "/cell/a/tf", "tf2_msgs/msg/TFMessage", HASH, Qos(1, False, True))
    assert "/3/1/MP/%/%cell%a/bridge/%cell%a%tf/" in node.token_of(entity, 1)
    assert node.token_of(entity, 1).endswith("/2:1:,1:,:,:,,")
    assert node.key_of(entity).startswith("0/cell/a/tf/")


def test_every_token_is_a_key_of_zenoh() -> None:
    for key in (NODE.token(), NODE.token_of(CHATTER, 1), NODE.key_of(CHATTER)):
        assert str(zenoh.KeyExpr(key)) == key


def test_an_attachment_is_read_as_zenoh_serializes_it() -> None:
    attachment = Attachment(7, 1_700_000_000_123_456_789, gid_of("token"))
    numbers = zenoh.ext.z_serialize((zenoh.ext.Int64(7), zenoh.ext.Int64(attachment.nanoseconds)))
    gid = zenoh.ext.z_serialize(attachment.gid)
    assert attachment.encoded() == numbers.to_bytes() + gid.to_bytes()
    assert read_attachment(attachment.encoded()) == attachment
    assert read_attachment(attachment.encoded()[:-1]) is None


@pytest.mark.parametrize(
    ("name", "shown"), [("cell-1", "cell_1"), ("3d.x", "m3d_x"), ("--", "machine"), ("arm6", "arm6")]
)
def test_names_of_machines_become_names_of_ros(name: str, shown: str) -> None:
    assert ros_name(name) == shown
