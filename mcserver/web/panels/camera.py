"""What the machine's camera sees, while somebody wants to."""

from __future__ import annotations

from urllib.parse import quote

from mcclient import Info
from nicegui import ui

from mcserver.web.link import MachineLink
from mcserver.web.translation import t

PERIOD_S = 1.0


class CameraPanel:
    """Closed until somebody opens it: the camera is asked only then; hidden without a camera."""

    def __init__(self, link: MachineLink) -> None:
        self._address = f"/machine/{quote(link.name)}/camera"
        self._count = 0
        self._card = ui.card().classes("mc-card")
        with self._card, ui.expansion(t("Camera")).classes("w-full mc-fold") as self._fold:
            self._picture = ui.element("img").classes("w-full").props(f'alt="{t("what the camera sees")}"')
        self._card.set_visibility(False)
        ui.timer(PERIOD_S, self._renew)

    def update(self, info: Info) -> None:
        self._card.set_visibility(bool(info.camera))

    def _renew(self) -> None:
        if self._fold.value and self._card.visible:
            self._count += 1
            self._picture.props(f'src="{self._address}?{self._count}"')
