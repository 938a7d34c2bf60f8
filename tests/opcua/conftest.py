"""One server with users and certificates, and two machines, for all tests here: its start takes seconds."""

from __future__ import annotations

from collections.abc import AsyncIterator

import pytest
import pytest_asyncio

from tests.opcua.machines import ODD, Files, Served, site_files, state


@pytest.fixture(scope="package")
def files(tmp_path_factory: pytest.TempPathFactory) -> Files:
    return site_files(tmp_path_factory.mktemp("opcua"))


@pytest_asyncio.fixture(scope="package", loop_scope="package")
async def served(files: Files) -> AsyncIterator[Served]:
    served = Served(files)
    await served.start()
    await served.look({"cell-1": state(), ODD: state()}, 1, 3)
    yield served
    await served.stop()
