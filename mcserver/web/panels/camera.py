"""What the machine's camera sees, while somebody wants to."""

from __future__ import annotations

from urllib.parse import quote

from mcclient import Info, MotionError
from nicegui import ui

from mcserver.web.camera import camera_picture
from mcserver.web.link import MachineLink
from mcserver.web.translation import t

PERIOD_S = 1.0


class CameraPanel:
    """Closed until somebody opens it: the camera is asked only then; hidden without a camera."""

    def __init__(self, link: MachineLink) -> None:
        self._link = link
        self._address = f"/machine/{quote(link.name)}/camera"
        self._count = 0
        self._card = ui.card().classes("mc-card")
        with self._card, ui.expansion(t("Camera")).classes("w-full mc-fold") as self._fold:
            self._picture = ui.element("img").classes("w-full").props(f'alt="{t("what the camera sees")}"')
            self._refusal = ui.label("").classes("w-full break-words").props("role=status")
        self._card.set_visibility(False)
        ui.timer(PERIOD_S, self._renew)

    def update(self, info: Info) -> None:
        self._card.set_visibility(bool(info.camera))

    async def _renew(self) -> None:
        if not (self._fold.value and self._card.visible):
            return
        said = ""
        try:
            await camera_picture(self._link)
        except MotionError as error:
            said = f"{t(error.message)} [{error.code}]"
        self._refusal.set_text(said)
        # the last picture of a camera that is silent would look like what it sees
        self._picture.set_visibility(not said)
        if not said:
            self._count += 1
            self._picture.props(f'src="{self._address}?{self._count}"')
