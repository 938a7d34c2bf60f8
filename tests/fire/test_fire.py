"""A few programs under fire; `make fire` goes on for hours. Needs root, skips without."""

from __future__ import annotations

import random
from collections.abc import Iterator

import pytest

from tests.e2e.servers import ServerProcess
from tests.fire.agreement import Journaled, disagreement
from tests.fire.disk import StallingDisk
from tests.fire.fire import Fault, burn, make_server
from tests.fire.link import BadLink, MissingMeans, bad_link

pytestmark = pytest.mark.timeout(300)


@pytest.fixture(scope="module")
def link() -> Iterator[BadLink]:
    try:
        with bad_link(500) as made:
            yield made
    except MissingMeans as missing:
        pytest.skip(str(missing))


@pytest.fixture(scope="module")
def disk(tmp_path_factory: pytest.TempPathFactory) -> StallingDisk:
    try:
        return StallingDisk(tmp_path_factory.mktemp("disk"))
    except MissingMeans as missing:
        pytest.skip(str(missing))


@pytest.fixture(scope="module")
def server(
    link: BadLink, disk: StallingDisk, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[ServerProcess]:
    made = make_server(link, tmp_path_factory.mktemp("fire"), disk)
    try:
        made.start()
        yield made
    finally:
        made.close()


TRIED = [Fault.LOSSY, Fault.CUT, Fault.SERVER_KILLED, Fault.DISK_STALLED_SERVER_KILLED]


@pytest.mark.parametrize("fault", TRIED, ids=lambda fault: fault.name)
def test_all_that_is_said_and_done_agrees(
    link: BadLink, server: ServerProcess, disk: StallingDisk, fault: Fault
) -> None:
    assert burn(link, server, fault, random.Random(7), disk).wrong == ""


SAID: dict[str, object] = {"state": "finished", "accepted": 12, "done": 12}
KEPT = Journaled("finished", 12, False, 12, 12)


def test_agreement_is_seen() -> None:
    assert disagreement(SAID, 10, KEPT, 5.0) == ""


@pytest.mark.parametrize(
    ("said", "kept", "moved"),
    [
        (SAID, KEPT, 4.5),
        (SAID, KEPT, 5.5),
        (SAID | {"accepted": 13}, KEPT, 5.0),
        (SAID, Journaled("finished", 12, True, 12, 12), 5.0),
        (SAID, Journaled("aborted", 12, False, 12, 7), 2.5),
        (SAID | {"state": "", "done": 9}, Journaled("aborted", 12, False, 12, 8), 4.0),
        (SAID | {"state": "", "done": 0}, Journaled("aborted", 12, False, 12, 8), 2.5),
    ],
)
def test_each_disagreement_is_seen(said: dict[str, object], kept: Journaled, moved: float) -> None:
    assert disagreement(said, 10, kept, moved)
