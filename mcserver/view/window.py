"""The picture in the browser, by viser: what is drawn, and how it is moved."""

from __future__ import annotations

import contextlib
import errno
import io
import socket
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np

from mcserver.errors import UsageFault
from mcserver.view.body import Body
from mcserver.view.solids import Array, Colour
from mcserver.view.stage import Stage, stage
from mcserver.view.tracks import Track

# of lines on the screen [pixels]
PATH_WIDTH = 2.0
LINE_WIDTH = 5.0
PATH: Colour = (150, 162, 176)
LIFT = 1e-3
TRAIL: Colour = (238, 102, 119)
# axes of drawn frames and tips, as shares of what is seen
FRAME_SIZE = 0.05
TIP_SIZE = 0.035
ZERO_SIZE = 0.04
# The cameras follow once what is travelled is so many times as large as it was.
GROWTH = 1.5


class Window:
    """A web page that shows a body; anyone who opens its address sees the same.

    Args:
        host, port: where it is served; port 0 takes a free one.
        title: of the page. body: what is drawn. standing: how it stands. tips: labels of its tips.

    Attributes:
        url: its address. gui: viser's controls beside the picture.

    Raises:
        UsageFault: MC017 the address cannot be listened on.
    """

    def __init__(
        self, host: str, port: int, *, title: str, body: Body, standing: Stage, tips: Sequence[str]
    ) -> None:
        # here, as it takes a second and is an extra
        import viser
        import viser.transforms

        _refuse_taken(host, port)
        self._rotation: Any = viser.transforms.SO3
        # its greeting would stand where results do
        with contextlib.redirect_stdout(io.StringIO()):
            server = viser.ViserServer(host, port, label=title, verbose=False)
        # a page could otherwise ask for a tunnel to a server outside
        server.request_share_url = _no_tunnel  # type: ignore[method-assign]
        self._server = server
        self._body = body
        self._size, self._up = standing.size, standing.up
        self._parts: dict[str, Any] = {}
        self._tips: dict[str, Any] = {}
        # as sent, by viser's name: what stands still is not sent again
        self._poses: dict[str, Array] = {}
        self._tracks: dict[str, Any] = {}
        self._line_paths: dict[str, Any] = {}
        self._paths_wanted = True
        # what has been travelled or will be, by name
        self._points: dict[str, Array] = {}
        self._zeros: dict[str, Any] = {}
        self._seen = 0.0
        self.gui = server.gui
        shown = f"[{host}]" if ":" in host else host
        self.url = f"http://{shown}:{server.get_port()}"
        try:
            self._furnish(title, standing, tips)
        except BaseException:
            self.close()
            raise

    def _furnish(self, title: str, standing: Stage, tips: Sequence[str]) -> None:
        self.gui.configure_theme(show_logo=False, show_share_button=False)
        self.gui.main_panel.dock_right()
        self.gui.set_panel_label(title)
        scene = self._server.scene
        scene.set_up_direction(standing.up)
        for place, part in enumerate(self._body.parts):
            # numbered: a slash in a link's name would make it the child of another
            name = f"/machine/{place}"
            self._parts[part.name] = scene.add_frame(
                name,
                show_axes=False,
                axes_length=FRAME_SIZE * standing.size,
                axes_radius=0.06 * FRAME_SIZE * standing.size,
            )
            for number, solid in enumerate(part.solids):
                scene.add_mesh_simple(
                    f"{name}/{number}",
                    solid.vertices.astype(np.float32),
                    solid.faces.astype(np.uint32),
                    color=solid.colour,
                )
        for label in tips:
            self._tips[label] = scene.add_frame(
                f"/tips/{label or 'tip'}",
                axes_length=TIP_SIZE * standing.size,
                axes_radius=0.07 * TIP_SIZE * standing.size,
            )
            if label:
                scene.add_label(f"/tips/{label}/name", label, anchor="bottom-center")
        self._add_floor(standing)
        camera = self._server.initial_camera
        camera.position = tuple(standing.camera)
        camera.look_at = tuple(standing.middle)
        camera.up = tuple(standing.up)

    def add_tracks(self, tracks: Sequence[Track]) -> None:
        """Draw paths in space."""
        for track in tracks:
            self._points[f"path {track.label}"] = track.points
            self._tracks[track.label] = self._draw(f"/paths/{track.label or 'path'}", track.points, PATH)

    @property
    def zeros(self) -> dict[str, Array]:
        """Where the zeros of coordinate systems are drawn, shape (3,) [m] by name."""
        return {name: np.asarray(frame.position) for name, frame in self._zeros.items()}

    def show_zeros(self, zeros: Mapping[str, Array]) -> None:
        """Draw the zeros of coordinate systems, shape (3,) [m] by name, as small frames, and no others."""
        scene = self._server.scene
        for name in self._zeros.keys() - zeros.keys():
            self._zeros.pop(name).remove()
        for name, at in zeros.items():
            if name in self._zeros:
                self._zeros[name].position = tuple(at)
                continue
            self._zeros[name] = scene.add_frame(
                f"/zeros/{name}",
                position=tuple(at),
                axes_length=ZERO_SIZE * self._size,
                axes_radius=0.05 * ZERO_SIZE * self._size,
            )
            scene.add_label(f"/zeros/{name}/name", name, anchor="top-center")

    def highlight(self, tracks: Sequence[Track], line: int, colour: Colour) -> None:
        """Draw what belongs to one line of the program in its colour, in place of the line before."""
        for track in tracks:
            before = self._line_paths.pop(track.label, None)
            if before is not None:
                before.remove()
            # a repeated path lies on itself: the line under way is drawn a little above
            points = track.of_line(line) + LIFT * self._size * self._up
            if len(points) > 1 and self._paths_wanted:
                name = f"/lines/{track.label or 'path'}"
                self._line_paths[track.label] = self._draw(name, points, colour, LINE_WIDTH)

    def show_trails(self, trails: Mapping[str, Array]) -> None:
        """Draw where tips have been, (n, 3) [m] by label, in place of what was drawn before."""
        for label, points in trails.items():
            self._points[f"trail {label}"] = points
            if len(points) > 1:
                self._draw(f"/trails/{label or 'tip'}", points, TRAIL)

    def fit(self) -> None:
        """Turn all cameras to what is travelled, as near as it is seen whole."""
        points = [each for each in self._points.values() if len(each)]
        if not points:
            return
        shown = stage((), {}, points, self._up)
        self._seen = shown.size
        cameras: list[Any] = [client.camera for client in self._server.get_clients().values()]
        for camera in [self._server.initial_camera, *cameras]:
            camera.up = tuple(self._up)
            camera.look_at = tuple(shown.middle)
            camera.position = tuple(shown.camera)

    def fit_where_it_grows(self) -> None:
        """`fit` where what is travelled has become much larger than it was when it was last fitted."""
        points = [each for each in self._points.values() if len(each)]
        if points and stage((), {}, points, self._up).size > max(GROWTH * self._seen, self._size):
            self.fit()

    def clear_trails(self) -> None:
        """Take the trails away."""
        self._points = {name: each for name, each in self._points.items() if not name.startswith("trail ")}
        self._server.scene.remove_by_name("/trails")

    def place(self, positions: Mapping[int, float], tips: Mapping[str, Array]) -> None:
        """Move everything: axes' positions [m or rad] by number, tips' frames (4, 4) by label."""
        with self._server.atomic():
            for name, pose in self._body.poses(positions).items():
                self._move(self._parts[name], pose)
            for label, pose in tips.items():
                self._move(self._tips[label], pose)

    def tip(self, label: str) -> tuple[float, float, float]:
        """Where a tip is drawn [m]."""
        x, y, z = (float(value) for value in self._tips[label].position)
        return x, y, z

    def show_frames(self, wanted: bool) -> None:
        """Draw the joints' frames, or not."""
        for name in self._body.frames:
            self._parts[name].show_axes = wanted

    def show_paths(self, wanted: bool) -> None:
        """Draw the paths, or not."""
        self._paths_wanted = wanted
        for path in (*self._tracks.values(), *self._line_paths.values()):
            path.visible = wanted

    @property
    def missing_meshes(self) -> tuple[str, ...]:
        """Meshes that could not be had, as the URDF names them."""
        return self._body.missing_meshes

    @property
    def watched(self) -> bool:
        """Whether somebody looks."""
        return bool(self._server.get_clients())

    def close(self) -> None:
        """End the page."""
        with contextlib.redirect_stdout(io.StringIO()):
            self._server.stop()

    def _draw(self, name: str, points: Array, colour: Colour, width: float = PATH_WIDTH) -> Any:
        return self._server.scene.add_line_segments(
            name,
            np.stack([points[:-1], points[1:]], axis=1).astype(np.float32),
            colour,
            thickness=width,
            thickness_units="screen",
        )

    def _move(self, handle: Any, pose: Array) -> None:
        before = self._poses.get(handle.name)
        if before is not None and np.array_equal(before, pose):
            return
        self._poses[handle.name] = pose
        handle.position = pose[:3, 3]
        handle.wxyz = self._rotation.from_matrix(pose[:3, :3]).wxyz

    def _add_floor(self, standing: Stage) -> None:
        side = 4.0 * standing.size
        planes: tuple[Literal["yz"], Literal["zx"], Literal["xy"]] = ("yz", "zx", "xy")
        plane = planes[int(np.argmax(np.abs(standing.up)))]
        cell = 10.0 ** np.floor(np.log10(standing.size / 3.0))
        position = standing.middle - standing.up * (standing.middle @ standing.up - standing.floor)
        self._server.scene.add_grid(
            "/floor",
            width=side,
            height=side,
            plane=plane,
            position=np.round(position / cell) * cell * (1.0 - np.abs(standing.up))
            + position * np.abs(standing.up),
            cell_size=cell,
            section_size=10.0 * cell,
            cell_color=(222, 227, 232),
            section_color=(190, 198, 207),
            fade_distance=5.0 * standing.size,
            shadow_opacity=0.18,
        )


def _no_tunnel(verbose: bool = True) -> None:
    """In place of viser's sharing."""


def _refuse_taken(host: str, port: int) -> None:
    """viser would silently take another port."""
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family[0], socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(family[4])
    except OSError as error:
        taken = error.errno == errno.EADDRINUSE
        raise UsageFault(
            "MC017",
            f"--host {host} --port {port} cannot be listened on: {error.strerror or error}",
            "take another port, or --port 0 for a free one" if taken else "127.0.0.1 is this computer alone",
        ) from error
