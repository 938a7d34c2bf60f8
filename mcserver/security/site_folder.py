"""A site's folder: the authority, and one configuration file for the router, each machine and each user.

Each file stands alone, with its certificate and key in it: copy it to its computer and nothing else. The
authority's key and the description of the site stay in the folder, which no other computer needs.
"""

from __future__ import annotations

import base64
import datetime
import json
import os
import secrets
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import msgspec

from mcserver.errors import ConfigurationError
from mcserver.net.keys import is_name
from mcserver.net.qos import reply_qos
from mcserver.security.access import access_control
from mcserver.security.certificates import (
    Credentials,
    new_application,
    new_authority,
    new_identity,
    new_signer,
)
from mcserver.security.site import Site, checked, machine_identity
from mcserver.security.site_files import ROUTER, SITE_FILE, configuration_path

AUTHORITY = "authority"
PASSWORDS_FILE = "passwords.txt"

Configuration = dict[str, Any]


def write_site(folder: Path, site: Site, now: datetime.datetime) -> list[Path]:
    """Make what is not there yet, and the router's rules anew; returns the files written.

    Certificates that are there stay: who has his file need not get another because somebody new comes.

    Raises:
        ConfigurationError: MC560.
    """
    checked(site)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        folder.chmod(0o700)
        authority = _authority(folder, now)
        written = [
            _write_identity(folder, site, authority, identity, now)
            for identity in site.identities()
            if not configuration_path(folder, identity).exists()
        ]
        passwords = _passwords(folder, site)
        if site.passwords:
            lines = [f"{name}:{password}\n" for name, password in sorted(passwords.items())]
            written.append(_write(folder / PASSWORDS_FILE, "".join(lines)))
        router = _router_credentials(folder, site, authority, now)
        path = configuration_path(folder, ROUTER)
        written.append(_write_configuration(path, _router(folder, site, authority, router), "The router"))
        written.append(_write(folder / SITE_FILE, msgspec.json.format(msgspec.json.encode(site)).decode()))
    except OSError as error:
        raise ConfigurationError(
            "MC560", f"{folder} cannot be written: {error}", "give another folder"
        ) from error
    return written


def signer_of(folder: Path, name: str, now: datetime.datetime) -> Credentials:
    """Return who signs approvals of runs under this name, made when it is first asked for.

    Raises:
        ConfigurationError: MC560 the folder is no site's, or the name does not fit.
    """
    return _made_once(folder, "signer", name, lambda authority: new_signer(authority, name, now))


def write_application(
    folder: Path, name: str, hosts: tuple[str, ...], now: datetime.datetime
) -> tuple[Path, Path]:
    """Return certificate and key of an OPC UA application, made when they are first asked for.

    Raises:
        ConfigurationError: MC560 the folder is no site's, or the name does not fit.
    """
    _made_once(folder, "opcua", name, lambda authority: new_application(authority, name, now, hosts))
    return folder / f"opcua.{name}.pem", folder / f"opcua.{name}.key"


def _made_once(folder: Path, kind: str, name: str, make: Callable[[Credentials], Credentials]) -> Credentials:
    authority = _kept(folder, AUTHORITY)
    if authority is None:
        raise ConfigurationError(
            "MC560", f"{folder} is no site's folder: it has no authority", "mcserver security init"
        )
    if not is_name(name):
        raise ConfigurationError("MC560", f"{name[:40]!r} is no name", "letters, digits, '-', '_', '.'")
    try:
        return _kept(folder, f"{kind}.{name}") or _keep(folder, f"{kind}.{name}", make(authority))
    except OSError as error:
        raise ConfigurationError(
            "MC560", f"{folder} cannot be written: {error}", "give another folder"
        ) from error


def _authority(folder: Path, now: datetime.datetime) -> Credentials:
    return _kept(folder, AUTHORITY) or _keep(folder, AUTHORITY, new_authority("motion site authority", now))


def _router_credentials(
    folder: Path, site: Site, authority: Credentials, now: datetime.datetime
) -> Credentials:
    hosts = tuple(dict.fromkeys((site.router, "localhost", "127.0.0.1")))
    name = f"{ROUTER}-{site.router.replace(':', '-')}"
    return _kept(folder, name) or _keep(folder, name, new_identity(authority, ROUTER, now, hosts=hosts))


def _kept(folder: Path, name: str) -> Credentials | None:
    certificate, key = folder / f"{name}.pem", folder / f"{name}.key"
    if not (certificate.exists() and key.exists()):
        return None
    return Credentials(certificate.read_bytes(), key.read_bytes())


def _keep(folder: Path, name: str, made: Credentials) -> Credentials:
    _write(folder / f"{name}.key", made.key.decode())
    _write(folder / f"{name}.pem", made.certificate.decode())
    return made


def _passwords(folder: Path, site: Site) -> Mapping[str, str]:
    """Of each identity, as its configuration has it."""
    if not site.passwords:
        return {}
    found = {}
    for identity in site.identities():
        text = configuration_path(folder, identity).read_text("utf-8").partition("\n")[2]
        credentials = json.loads(text)["transport"].get("auth", {}).get("usrpwd")
        if credentials is None:
            raise ConfigurationError(
                "MC560",
                f"{identity} was made without a password",
                f"remove {configuration_path(folder, identity).name} and run init again",
            )
        found[identity] = credentials["password"]
    return found


def _write_identity(
    folder: Path, site: Site, authority: Credentials, identity: str, now: datetime.datetime
) -> Path:
    machines = {machine_identity(machine) for machine in site.machines}
    made = new_identity(authority, identity, now)
    link: Configuration = {
        "tls": {
            "root_ca_certificate_base64": _base64(authority.certificate),
            "connect_certificate_base64": _base64(made.certificate),
            "connect_private_key_base64": _base64(made.key),
            "enable_mtls": True,
            "verify_name_on_connect": True,
        }
    }
    transport: Configuration = {"shared_memory": {"enabled": False}, "link": link}
    if site.passwords:
        transport["auth"] = {"usrpwd": {"user": identity, "password": secrets.token_urlsafe(24)}}
    configuration: Configuration = {
        "mode": "client",
        "connect": {"endpoints": [site.endpoint]},
        "scouting": {"multicast": {"enabled": False}},
        "transport": transport,
    }
    if identity in machines:
        comment = f"The machine {identity.partition('.')[2]}: mcserver run --zenoh-config"
    else:
        # the client id begins with it, as the router's rules demand
        configuration["metadata"] = {"user": identity}
        comment = f"{identity}: mcctl --zenoh-config"
    return _write_configuration(configuration_path(folder, identity), configuration, comment)


def _router(folder: Path, site: Site, authority: Credentials, own: Credentials) -> Configuration:
    transport: Configuration = {
        "shared_memory": {"enabled": False},
        "unicast": {"accept_pending": 2000, "accept_timeout": 5000, "max_sessions": 10_000},
        "link": {
            "tx": {
                "lease": 2000,
                # a client that takes nothing for so long loses its link: until then it holds up its machine's
                # messages to others
                "queue": {
                    "congestion_control": {
                        "block": {"wait_before_close": 500_000},
                        # for so long at most a large reply that its caller does not take does the same
                        "drop": {"wait_before_drop": 100, "max_wait_before_drop_fragments": 20_000},
                    },
                    "size": {"interactive_high": 16, "interactive_low": 16},
                },
            },
            "tls": {
                "root_ca_certificate_base64": _base64(authority.certificate),
                "listen_certificate_base64": _base64(own.certificate),
                "listen_private_key_base64": _base64(own.key),
                "enable_mtls": True,
            },
        },
    }
    if site.passwords:
        transport["auth"] = {"usrpwd": {"dictionary_file": str((folder / PASSWORDS_FILE).resolve())}}
    return {
        "mode": "router",
        "listen": {"endpoints": [f"tls/0.0.0.0:{site.port}"]},
        "scouting": {"multicast": {"enabled": False}},
        "timestamping": {"enabled": True},
        "adminspace": {"enabled": True, "permissions": {"read": True, "write": False}},
        "transport": transport,
        "qos": {"network": reply_qos()},
        "access_control": access_control(site),
    }


def _base64(pem: bytes) -> str:
    return base64.b64encode(pem).decode()


def _write_configuration(path: Path, configuration: Configuration, comment: str) -> Path:
    return _write(
        path, f"// {comment} {path.name} (holds a private key)\n{json.dumps(configuration, indent=2)}\n"
    )


def _write(path: Path, text: str) -> Path:
    """Write a file that nobody else may read, whole or not at all."""
    beside = path.with_name(path.name + ".new")
    beside.unlink(missing_ok=True)
    handle = os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(handle, "w", encoding="utf-8") as file:
        file.write(text)
    beside.replace(path)
    return path
