"""A machine drawn in space in the browser: its parts, the path of a program, and where its tips went."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

# three.js comes with NiceGUI's own scenes: importing them lets the browser find it
import nicegui.elements.scene  # noqa: F401
from nicegui.element import Element


class Space(Element, component="static/space.js"):
    """The picture; lengths in mm, angles in degrees.

    Its event ``picked`` has the line of the path that was clicked on.

    Args:
        label: for those who cannot see it. model_url: of the machine's parts; empty: none are drawn.
    """

    def __init__(self, label: str, model_url: str = "") -> None:
        super().__init__()
        self._props["label"] = label
        self._props["model-url"] = model_url
        self.is_ready = False
        self.on("ready", self._on_ready, args=[])

    def place(
        self,
        axes: dict[int, float],
        tips: Mapping[str, Sequence[float]],
        line: int,
        trail: dict[str, list[list[float]]],
        *,
        restart: bool = False,
    ) -> None:
        """Draw one state.

        Args:
            tips: by label, such as ``T3``; empty: the axes' own. line: under way. trail: points to add.
            restart: forget the trails first.
        """
        self.run_method(
            "place", {"axes": axes, "tips": tips, "line": line, "trail": trail, "restart": restart}
        )

    def show_row(
        self,
        axes: dict[int, float],
        tips: Mapping[str, Sequence[float]],
        row: int,
        span: tuple[int, int] | None,
    ) -> None:
        """Draw one row of a recording whose path was given by `plan`: done is what comes before it.

        Args:
            span: first and last row of the line under way, which has a colour of its own.
        """
        self.run_method("showRow", {"axes": axes, "tips": tips}, row, span)

    def plan(self, path: dict[str, Any] | None) -> None:
        """Draw a program's path to come, as the call ``simulate`` gives it."""
        self.run_method("plan", path)

    def mark_line(self, line: int) -> None:
        """Mark the part of the path that a line of the program drives, or where it stands in it."""
        self.run_method("mark", line)

    def zeros(self, places: Mapping[str, Sequence[float]]) -> None:
        """Mark where coordinate systems have their zeros [mm], by name, in the place of those before."""
        self.run_method("zeros", places)

    def frames(self, shown: bool) -> None:
        """Show or hide the frame of each joint."""
        self.run_method("frames", shown)

    def reach(self, spans: Mapping[str, Mapping[int, tuple[float, float]]]) -> None:
        """Mark places that tips can be at, with their axes somewhere between two positions.

        Args:
            spans: by label of the tip, by axis: least and greatest position [mm, deg]; without any, none are.
        """
        self.run_method("reach", spans)

    def show_bodies(self, tools: Sequence[Mapping[str, Any]], inputs: Mapping[str, bool]) -> None:
        """Show the bodies of the tools that are mounted, and zones that inputs have off as edges alone.

        Args:
            tools: maps `MountedTool`. inputs: by name whether they are high.
        """
        self.run_method("showBodies", {"tools": tools, "inputs": inputs})

    def look_at_all(self) -> None:
        """Turn the camera to all that is drawn."""
        self.run_method("lookAtAll")

    def _on_ready(self) -> None:
        # what is sent to a picture that is not there yet is lost; after a reload it is another one
        self.is_ready = True
