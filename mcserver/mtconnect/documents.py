"""The agent's answers as XML: Devices, Streams, Assets and Error (Part 1; schemas of version 2.0)."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from typing import NamedTuple

from mcserver.mtconnect.buffer import Observation
from mcserver.mtconnect.device import DataItem, Device

VERSION = "2.0"
# categories in the order of a component's stream, and the element that holds each
GROUPS = {"SAMPLE": "Samples", "EVENT": "Events", "CONDITION": "Condition"}


class Header(NamedTuple):
    """What every document says of the agent."""

    sender: str
    instance: int
    buffer_size: int
    wall: float
    devices_wall: float

    def attributes(self, **more: int) -> dict[str, str]:
        """Return the attributes of ``Header`` that documents on devices have."""
        return self.of_error() | {
            "deviceModelChangeTime": utc(self.devices_wall),
            **{name: str(value) for name, value in more.items()},
        }

    def of_error(self) -> dict[str, str]:
        """Return the attributes that every document has."""
        return {
            "creationTime": utc(self.wall),
            "sender": self.sender,
            "instanceId": str(self.instance),
            "version": f"{VERSION}.0.0",
            "bufferSize": str(self.buffer_size),
        }


class Place(NamedTuple):
    """Of a Streams document: its first, last and next numbers."""

    first: int
    last: int
    next: int


def utc(wall: float) -> str:
    """Return a Unix time as ISO 8601 in UTC, to the millisecond."""
    return datetime.fromtimestamp(wall, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def devices_document(header: Header, devices: Sequence[Device]) -> bytes:
    """Return MTConnectDevices."""
    document = _document("Devices", header.attributes(assetBufferSize=1, assetCount=0))
    ElementTree.SubElement(document, "Devices").extend(each.element for each in devices)
    return _bytes(document)


def streams_document(
    header: Header, place: Place, devices: Sequence[Device], observations: Iterable[Observation]
) -> bytes:
    """Return MTConnectStreams: of each device the components with observations."""
    numbers = header.attributes(firstSequence=place.first, lastSequence=place.last, nextSequence=place.next)
    document = _document("Streams", numbers)
    streams = ElementTree.SubElement(document, "Streams")
    by_item: dict[str, list[Observation]] = {}
    for observation in observations:
        by_item.setdefault(observation.item, []).append(observation)
    for device in devices:
        stream = ElementTree.SubElement(streams, "DeviceStream", name=device.name, uuid=device.uuid)
        for component, items in _by_component(device, by_item):
            shown = ElementTree.SubElement(
                stream,
                "ComponentStream",
                component=component.tag,
                name=component.attrib["name"],
                componentId=component.attrib["id"],
            )
            for category, group in GROUPS.items():
                some = [each for each in items if each.category == category]
                if some:
                    parent = ElementTree.SubElement(shown, group)
                    for item in some:
                        for observation in by_item[item.id]:
                            _add(parent, item, observation)
    return _bytes(document)


def assets_document(header: Header) -> bytes:
    """Return MTConnectAssets; the agent has none."""
    attributes = header.attributes(assetBufferSize=1, assetCount=0)
    del attributes["bufferSize"]
    document = _document("Assets", attributes)
    ElementTree.SubElement(document, "Assets")
    return _bytes(document)


def error_document(header: Header, code: str, text: str) -> bytes:
    """Return MTConnectError with one error."""
    document = _document("Error", header.of_error())
    errors = ElementTree.SubElement(document, "Errors")
    ElementTree.SubElement(errors, "Error", errorCode=code).text = text
    return _bytes(document)


def _by_component(
    device: Device, seen: dict[str, list[Observation]]
) -> Iterable[tuple[ElementTree.Element, list[DataItem]]]:
    found: dict[ElementTree.Element, list[DataItem]] = {}
    for item in device.items.values():
        if item.id in seen:
            found.setdefault(item.component, []).append(item)
    return found.items()


def _add(parent: ElementTree.Element, item: DataItem, observation: Observation) -> None:
    reading = observation.reading
    shared = {"dataItemId": item.id, "sequence": str(observation.sequence), "timestamp": observation.time}
    if item.category == "CONDITION":
        # Unavailable, Normal, Fault are elements; the type is an attribute
        code = {"nativeCode": reading.code} if reading.code else {}
        name = reading.value.capitalize()
        ElementTree.SubElement(parent, name, shared | {"type": item.type} | code).text = reading.text or None
        return
    optional = {"subType": item.sub_type} if item.sub_type else {}
    if item.type.startswith("ASSET_"):
        # there are none
        optional["assetType"] = ""
    name = "".join(word.capitalize() for word in item.type.split("_"))
    ElementTree.SubElement(parent, name, shared | optional).text = reading.value


def _document(kind: str, header: dict[str, str]) -> ElementTree.Element:
    namespace = f"urn:mtconnect.org:MTConnect{kind}:{VERSION}"
    document = ElementTree.Element(f"MTConnect{kind}", xmlns=namespace)
    ElementTree.SubElement(document, "Header", header)
    return document


def _bytes(document: ElementTree.Element) -> bytes:
    written: bytes = ElementTree.tostring(document, encoding="utf-8", xml_declaration=True)
    return written
