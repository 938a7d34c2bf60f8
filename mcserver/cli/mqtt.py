"""``mcserver mqtt``: states of all machines for an MQTT broker."""

from __future__ import annotations

import contextlib
import os
import ssl
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated
from urllib.parse import urlsplit

import typer

from mcserver.cli.console import narration
from mcserver.cli.options import ConnectOption, ZenohConfigOption
from mcserver.cli.serving import require_packages, run_until_stopped
from mcserver.errors import ConfigurationError

if TYPE_CHECKING:
    from mcserver.mqtt.bridge import Broker
    from mcserver.mqtt.publishers import Publisher

PORTS = {"mqtt": 1883, "mqtts": 8883}
PASSWORD = "MC_MQTT_PASSWORD"


def mqtt(
    broker: Annotated[
        str, typer.Argument(metavar="URL", help="mqtt://[USER@]HOST[:PORT], or mqtts:// for TLS.")
    ],
    connect: ConnectOption = None,
    zenoh: ZenohConfigOption = None,
    prefix: Annotated[str, typer.Option("--prefix", help="First level of the plain topics.")] = "mcserver",
    sparkplug: Annotated[
        str | None,
        typer.Option("--sparkplug", metavar="GROUP/NODE", help="Sparkplug B in place of plain topics."),
    ] = None,
    rate: Annotated[
        float, typer.Option("--rate", min=0.1, max=20.0, help="Looks a second at each machine.")
    ] = 1.0,
    authority: Annotated[
        Path | None, typer.Option("--authority", metavar="PEM", help="Who signed the broker's certificate.")
    ] = None,
) -> None:
    """Publish the states of all machines to an MQTT broker, until Ctrl-C; $MC_MQTT_PASSWORD is the user's."""
    require_packages("mqtt", "mqtt", ("aiomqtt", "mcclient"))
    from mcserver.mqtt.bridge import Bridge
    from mcserver.mqtt.publishers import PlainTopics, SparkplugNode

    found = _broker_at(broker, authority)
    publisher: Publisher
    if sparkplug is None:
        publisher = PlainTopics(_levels(prefix, 1)[0])
    else:
        group, node = _levels(sparkplug, 2)
        publisher = SparkplugNode(group, node, time.time)
    narration().print(f"MQTT: {found.host}:{found.port} (Ctrl-C ends)")
    run_until_stopped(Bridge(publisher, 1.0 / rate).run(found, tuple(connect or ()), zenoh))


def _broker_at(address: str, authority: Path | None) -> Broker:
    """Return the broker of an address.

    Raises:
        ConfigurationError: MC079 no address, or one with a password, which others would see; an authority
            that cannot be read, or without TLS.
    """
    from mcserver.mqtt.bridge import Broker

    tls = _trust(authority) if address.startswith("mqtts:") else None
    if authority is not None and tls is None:
        raise ConfigurationError(
            "MC079", "an authority is given, and the broker is reached without TLS", "give mqtts://…"
        )
    with contextlib.suppress(ValueError):
        url = urlsplit(address)
        port = url.port or PORTS.get(url.scheme)
        if url.hostname and port and url.scheme in PORTS and url.password is None and not url.path.strip("/"):
            secret = os.environ.get(PASSWORD)
            return Broker(url.hostname, port, tls, url.username, secret)
    raise ConfigurationError(
        "MC079",
        "the broker's address cannot be read, or has a password in it",
        f"mqtt://USER@HOST:PORT or mqtts://USER@HOST:PORT; the password stands in ${PASSWORD}",
    )


def _trust(authority: Path | None) -> ssl.SSLContext:
    """Return whose certificates a broker may show: the system's authorities', or this one's."""
    try:
        return ssl.create_default_context(cafile=authority)
    except OSError as error:
        raise ConfigurationError(
            "MC079",
            f"the authority {authority} cannot be read: {error.strerror or error}",
            "give the PEM file of who signed the broker's certificate",
        ) from error


def _levels(text: str, count: int) -> list[str]:
    levels = text.split("/")
    if len(levels) != count or not all(levels) or any(letter in text for letter in "+#\0"):
        raise ConfigurationError(
            "MC079",
            f"{text!r} cannot be {'a level' if count == 1 else 'GROUP/NODE'} of topics",
            "names without + # and further /",
        )
    return levels
