"""Lead the tool of an arm by the mouse: it goes where the pointer is on a page, while a button is pressed.

mcserver run --machine arm6, then: python examples/servo_mouse.py [--reach 60] [--hz 50] [--port 8090]
It needs NiceGUI: pip install 'mcserver[web]'.
"""

from __future__ import annotations

import argparse
import asyncio

import numpy as np
from mcclient import Machine, MotionError
from nicegui import app, events, ui

TOOL = 1
SIDE_PX = 500


class Pad:
    """A square that stands for the tool's Y and Z; only this computer's browsers reach it.

    Attributes:
        wanted: the pointer from the middle of the square to its ends, -1 to 1, right and up.
        said: what the page shows.
    """

    def __init__(self) -> None:
        self.wanted = np.zeros(2)
        self.said = "not connected"

    def show(self) -> None:
        """Build the page."""
        square = ui.element("div").style(
            f"width:{SIDE_PX}px;height:{SIDE_PX}px;background:#dde;touch-action:none;cursor:crosshair"
        )
        for kind in ("pointerdown", "pointermove"):
            square.on(kind, self._take, args=["offsetX", "offsetY", "buttons"], throttle=0.02)
        ui.label().bind_text_from(self, "said")

    def _take(self, event: events.GenericEventArguments) -> None:
        if event.args["buttons"]:
            place = np.array([event.args["offsetX"], SIDE_PX - event.args["offsetY"]])
            self.wanted = np.clip(2.0 * place / SIDE_PX - 1.0, -1.0, 1.0)

    async def lead(self, options: argparse.Namespace) -> None:
        """Stream the pose that the pointer stands for; a page that is gone leaves the tool where it is."""
        try:
            async with Machine.connect(options.machine, options.connect) as machine:
                (tool,) = [each for each in (await machine.status()).tools if each.number == TOOL]
                pose = np.array([*tool.position, *tool.orientation])
                middle = pose[1:3].copy()
                async with machine.servo(counts_s=0.5) as servo:
                    while True:
                        pose[1:3] = middle + options.reach * self.wanted
                        await servo.send(pose, tool=TOOL)
                        self.said = f"Y {pose[1]:.1f} mm, Z {pose[2]:.1f} mm"
                        await asyncio.sleep(1.0 / options.hz)
        except MotionError as error:
            self.said = str(error)


def main() -> None:
    """Read the options and serve the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--machine", help="its name, where there are several")
    parser.add_argument("--connect", help="Zenoh endpoint of the server")
    parser.add_argument("--reach", type=float, default=60.0, help="from the middle to the ends [mm]")
    parser.add_argument("--hz", type=float, default=50.0)
    parser.add_argument("--port", type=int, default=8090)
    options = parser.parse_args()
    pad = Pad()
    leading: list[asyncio.Task[None]] = []
    app.on_startup(lambda: leading.append(asyncio.create_task(pad.lead(options))))
    app.on_shutdown(lambda: [each.cancel() for each in leading])
    ui.run(pad.show, host="127.0.0.1", port=options.port, title="servo mode", show=False, reload=False)


if __name__ == "__main__":
    main()
