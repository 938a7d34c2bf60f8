"""An approval as a signed file lets this very run start, and nothing else.

Real planning and a real executor on a virtual clock, as in `tests.net.test_approvals`.
"""

from __future__ import annotations

import base64
import datetime
import json
from collections.abc import AsyncIterator
from pathlib import Path

import msgspec
import numpy as np
import pytest

from mcserver.errors import ServiceError
from mcserver.machine.machine_file import parse_machine
from mcserver.net import arming_messages as wire
from mcserver.net.certified_runs import approval_of, refuse_other_motion
from mcserver.security.certificates import Credentials, new_authority, new_identity, new_signer
from mcserver.service.approval_basis import ApprovalBasis
from mcserver.service.run_certificate import Approval, sign
from mcserver.simulation.preview import preview
from tests.net.approval_site import ANNA, BOT, MILL, SHIFT, TEXT, Site

NOW = datetime.datetime(2031, 5, 4, 12, 0, tzinfo=datetime.UTC)
HOUR = datetime.timedelta(hours=1)
AUTHORITY = new_authority("site", NOW - HOUR)
SIGNER = new_signer(AUTHORITY, "anna", NOW - HOUR)


@pytest.fixture
async def site(tmp_path: Path) -> AsyncIterator[Site]:
    made = Site(parse_machine(MILL), tmp_path)
    at(made, NOW)
    yield made
    await made.cell.stop()


def at(site: Site, now: datetime.datetime, authority: bytes | None = AUTHORITY.certificate) -> None:
    service = site.cell.service
    service.options = msgspec.structs.replace(
        service.options, clock=lambda: now.timestamp(), authority=authority
    )


async def approved(site: Site, text: str = TEXT, **changed: object) -> Approval:
    """What the server says can be certified of a run from where its machine stands."""
    run = await site.ask(text)
    seen = site.arming.run_preview(BOT, wire.RunPreviewRequest(sha256=run.sha256))
    site.arming.withdraw(BOT, wire.WithdrawRequest(sha256=run.sha256))
    approval = msgspec.json.decode(seen.certifiable, type=Approval)
    return msgspec.structs.replace(approval, **{"until": (NOW + HOUR).timestamp(), **changed})


async def certificate(site: Site, text: str = TEXT, signer: Credentials = SIGNER, **changed: object) -> str:
    return sign(await approved(site, text, **changed), signer.certificate, signer.key).decode()


async def ask(site: Site, certificate: str, text: str = TEXT, client: str = BOT) -> wire.RunRequestReply:
    return await site.arming.request_run(client, wire.RunRequestRequest(text=text, certificate=certificate))


async def refusal(site: Site, certificate: str, text: str = TEXT, client: str = BOT) -> tuple[str, str]:
    """Code and words of the refusal; nothing is armed and nothing waits."""
    with pytest.raises(ServiceError) as refused:
        await ask(site, certificate, text, client)
    assert site.arming.run_requests(client, wire.RunRequestsRequest()).requests == []
    return refused.value.code, refused.value.message


async def test_a_certified_run_is_armed_by_its_signer_and_keeps_its_envelope(site: Site) -> None:
    reply = await ask(site, await certificate(site, override=0.5))
    assert reply.run is not None
    assert (reply.run.state, reply.run.operator, reply.run.override) == ("armed", "anna", 50.0)
    program = await site.run()
    assert program.state == "finished", program.fault
    assert program.envelope is not None
    assert np.allclose(site.extent(), (0.0, 50.0))


async def test_it_runs_again_from_the_same_state(site: Site) -> None:
    await site.by_hand("G1 X5 F6000", "G1 X0")
    signed = await certificate(site)
    for _ in range(2):
        await ask(site, signed)
        assert (await site.run()).state == "finished"


async def test_a_changed_text_is_refused(site: Site) -> None:
    code, message = await refusal(site, await certificate(site), TEXT + "\nG1 X60")
    assert code == "MC579"
    assert "another text" in message


async def test_a_certificate_has_the_operators_switches_and_others_are_refused(site: Site) -> None:
    text = "G1 X10 F6000\n/G1 X50\nM01"
    asked = wire.RunRequestRequest(text=text, block_delete=True, optional_stop=False)
    reply = await site.arming.request_run(BOT, asked)
    assert reply.run is not None
    seen = site.arming.run_preview(BOT, wire.RunPreviewRequest(sha256=reply.run.sha256))
    approval = msgspec.structs.replace(
        msgspec.json.decode(seen.certifiable, type=Approval), until=(NOW + HOUR).timestamp()
    )
    signed = sign(approval, SIGNER.certificate, SIGNER.key).decode()
    with pytest.raises(ServiceError) as refused:
        await site.arming.request_run(
            BOT, msgspec.structs.replace(asked, block_delete=False, certificate=signed)
        )
    assert refused.value.code == "MC579"
    certified = (await ask(site, signed, text)).run
    assert certified is not None
    assert (certified.state, certified.block_delete, certified.optional_stop) == ("armed", True, False)
    program = await site.run(text)
    assert (program.state, program.done) == ("finished", 3)
    assert np.allclose(site.extent(), (0.0, 10.0))


@pytest.mark.parametrize(
    ("text", "by_hand"),
    [
        (TEXT, "G1 X10 F6000"),
        (TEXT, SHIFT),
        ("T2 M6\nG43 H2\nG1 Z-5 F600", "G10 L1 P2 Z45"),
        (TEXT, "M64 P0"),
    ],
    ids=["position", "offset", "tool", "output"],
)
async def test_what_was_changed_since_is_refused(site: Site, text: str, by_hand: str) -> None:
    signed = await certificate(site, text)
    await site.by_hand(by_hand)
    code, message = await refusal(site, signed, text)
    assert code == "MC572"
    assert by_hand != "G1 X10 F6000" or "X" in message


async def test_another_machine_file_is_refused(site: Site, tmp_path: Path) -> None:
    signed = await certificate(site)
    (tmp_path / "b").mkdir()
    faster = Site(parse_machine(MILL.replace("max_velocity = 500.0", "max_velocity = 600.0")), tmp_path / "b")
    at(faster, NOW)
    code, message = await refusal(faster, signed)
    assert code == "MC579"
    assert "another machine file" in message
    await faster.cell.stop()


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"version": "0.0.9"}, ["0.0.9"]),
        ({"setpoints": "0" * 64}, ["this computer plans other setpoints", "certified are 000000000000"]),
        ({"digest": "0" * 64}, []),
    ],
    ids=["version", "setpoints", "another run"],
)
async def test_what_was_certified_otherwise_is_named_and_refused(
    site: Site, changed: dict[str, str], words: list[str]
) -> None:
    code, message = await refusal(site, await certificate(site, **changed))
    assert code == "MC579"
    assert [each for each in words if each not in message] == []


async def test_it_expires(site: Site) -> None:
    signed = await certificate(site)
    at(site, NOW + HOUR)
    code, message = await refusal(site, signed)
    assert code == "MC578"
    assert "expired at 2031-05-04 13:00:00" in message


async def test_a_restart_ends_no_certificate(site: Site, tmp_path: Path) -> None:
    signed = await certificate(site)
    (tmp_path / "again").mkdir()
    again = Site(parse_machine(MILL), tmp_path / "again", "second")
    at(again, NOW)
    await ask(again, signed)
    assert (await again.run()).state == "finished"
    await again.cell.stop()


async def test_an_emergency_stop_takes_the_arming_back(site: Site) -> None:
    await ask(site, await certificate(site))
    site.cell.service.latch.emergency_stop(ANNA, "stop")
    with pytest.raises(ServiceError, match="MC571"):
        await site.start()


@pytest.mark.parametrize(
    ("signer", "why"),
    [
        (new_signer(new_authority("site", NOW - HOUR), "anna", NOW - HOUR), "not of this site"),
        (new_identity(AUTHORITY, "anna", NOW - HOUR), "anna may not sign approvals"),
        (new_signer(AUTHORITY, "anna", NOW - datetime.timedelta(days=1000)), "the key of anna has expired"),
        (Credentials(SIGNER.certificate, new_signer(AUTHORITY, "anna", NOW).key), "was changed"),
    ],
)
async def test_a_foreign_key_is_refused(site: Site, signer: Credentials, why: str) -> None:
    code, message = await refusal(site, await certificate(site, signer=signer))
    assert code == "MC578"
    assert why in message


async def test_a_server_without_a_site_trusts_nobody(site: Site) -> None:
    signed = await certificate(site)
    at(site, NOW, None)
    assert (await refusal(site, signed))[0] == "MC578"


async def test_who_asks_may_not_have_signed(site: Site) -> None:
    assert (await refusal(site, await certificate(site), client=ANNA))[0] == "MC575"


@pytest.mark.parametrize("where", ["approval", "signature", "certificate"])
async def test_a_byte_that_was_changed_is_refused(site: Site, where: str) -> None:
    content = json.loads(await certificate(site))
    if where == "approval":
        content["approval"]["override"] = 2.0
    elif where == "signature":
        raw = bytearray(base64.b64decode(content["signature"]))
        raw[-1] ^= 1
        content["signature"] = base64.b64encode(bytes(raw)).decode()
    else:
        content["certificate"] = AUTHORITY.certificate.decode()
    assert (await refusal(site, json.dumps(content)))[0] == "MC578"


@pytest.mark.parametrize(
    "text", ["", "{}", "[]", "null", "x" * 1000, '{"approval": {}, "signature": "?", "certificate": ""}']
)
async def test_garbage_is_refused(site: Site, text: str) -> None:
    assert (await refusal(site, text))[0] == "MC578"


class LaterApproval(Approval, frozen=True):
    """What a later version might certify besides."""

    room: str


async def test_an_approval_that_says_more_than_this_server_knows_is_refused(site: Site) -> None:
    later = LaterApproval(**msgspec.structs.asdict(await approved(site)), room="hall 2")
    code, message = await refusal(site, sign(later, SIGNER.certificate, SIGNER.key).decode())
    assert code == "MC578"
    assert "another version has made it" in message


async def test_what_can_be_certified_reads_back_to_the_bit(site: Site) -> None:
    await site.by_hand(SHIFT, "G1 X-123.456789 F6000")
    approval = await approved(site)
    start = site.cell.service.start_state()
    assert approval.start == start
    basis = ApprovalBasis(site.machine)
    seen = preview(TEXT, site.machine, approval.start, approval.axes)
    refuse_other_motion(approval, seen)
    again = approval_of(basis, TEXT, approval.axes, approval.start, seen)
    assert msgspec.structs.replace(again, until=approval.until) == approval
