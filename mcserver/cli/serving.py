"""What commands that serve an application share: packages, roles, and how their address is announced."""

from __future__ import annotations

import asyncio
import contextlib
import importlib.util
import signal
import sys
from typing import TYPE_CHECKING

from mcserver.cli.console import narration, write_json
from mcserver.errors import NEEDS_LINUX, ConfigurationError

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

    from mcserver.net.roles import Role


def require_packages(command: str, extra: str, modules: tuple[str, ...]) -> None:
    """Check that the packages of an optional part are there.

    Raises:
        ConfigurationError: MC016 some are missing.
    """
    missing = [name for name in modules if importlib.util.find_spec(name) is None]
    if missing:
        raise ConfigurationError(
            "MC016",
            f"mcserver {command} needs {', '.join(missing)}",
            f"pip install 'mcserver[{extra}]' mcclient",
        )


def require_linux(what: str) -> None:
    """Check that this is Linux, whose clocks, sockets and shared memory a cycle is made of.

    Raises:
        ConfigurationError: MC025 it is another system.
    """
    if sys.platform != "linux":
        raise ConfigurationError("MC025", f"{what} needs Linux, and this is {sys.platform}", NEEDS_LINUX)


def role_of(name: str, code: str) -> Role:
    """Return the role of that name.

    Raises:
        ConfigurationError: ``code`` there is no such role.
    """
    from mcserver.net.roles import EVERYBODY, Role, roles_named

    try:
        return Role(name)
    except ValueError:
        raise ConfigurationError(code, f"there is no role {name!r}", roles_named(EVERYBODY)) from None


def run_until_stopped(main: Coroutine[object, object, None]) -> None:
    """Run what watches machines until Ctrl-C or SIGTERM, which cancel it: what has gathered is written."""

    from mcclient.cli.signals import on_signals

    async def run() -> None:
        task = asyncio.current_task()
        assert task is not None
        on_signals([signal.SIGTERM], task.cancel)
        await main

    with contextlib.suppress(KeyboardInterrupt, asyncio.CancelledError):
        asyncio.run(run())


def announcing(served: str, *, json: bool) -> Callable[[str], None]:
    """Return what says where an application is served, once it is ready."""

    def ready(url: str) -> None:
        narration().print(f"{served}: {url} (Ctrl-C ends)")
        if json:
            write_json({"ok": True, "url": url})

    return ready
