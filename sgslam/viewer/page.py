"""A page in the browser (viser) with named 3D objects; only changes are sent."""

import atexit
import contextlib
import io
import re
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.geometry.poses import poses_to_xyzquat
from sgslam.viewer.shapes import Mesh

if TYPE_CHECKING:
    import viser

Floats = NDArray[np.float64]
Colour = tuple[int, int, int]
HOST, PORT = "127.0.0.1", 8080
_STILL = 1e-4  # change of a pose's entries below which it is not sent


@dataclass
class _Shown:
    handle: Any
    content: tuple[Any, ...]
    pose: Floats | None = None


def parse_address(text: str) -> tuple[str, int]:
    """Parses `[HOST:]PORT`. Raises UserError if it is invalid."""
    host, _, port = text.rpartition(":")
    if not re.fullmatch(r"\d{1,5}", port) or int(port) > 65535:
        raise UserError(f"{text}: not a port; give PORT or HOST:PORT, such as {PORT} or 0.0.0.0:{PORT}")
    return host or HOST, int(port)


class Page:
    """A page with named objects. `server` is viser's, with its `gui` and `scene`; `url` is the page's address.

    All positions are relative to `origin` (3,): browsers use single precision, and sites lie kilometres from zero.
    """

    def __init__(self, at: tuple[str, int] = (HOST, PORT), title: str = "sgslam") -> None:
        """Opens the page; port 0 takes any free port. Raises UserError if viser is missing or the port is in use."""
        self.server = _start_server(*at, title)
        host = "localhost" if at[0] in ("0.0.0.0", "::", HOST) else at[0]
        self.url = f"http://{host}:{self.server.get_port()}"
        self.origin = np.zeros(3)
        self._shown: dict[str, _Shown] = {}
        atexit.register(self.close)
        self._lock = threading.RLock()  # one thread draws, others handle the controls

    def clear(self) -> None:
        """Removes all objects and controls."""
        with self._lock:
            for name in {name.split("/")[1] for name in self._shown}:
                self.remove(f"/{name}")
            self.server.gui.reset()

    def close(self) -> None:
        """Stops the server."""
        atexit.unregister(self.close)
        with contextlib.redirect_stdout(io.StringIO()):
            self.server.stop()

    @contextmanager
    def atomic(self) -> Iterator[None]:
        """Context in which all changes are sent together and no other thread makes changes."""
        with self._lock, self.server.atomic():
            yield

    @property
    def names(self) -> frozenset[str]:
        """The names of all objects, shown or hidden."""
        return frozenset(self._shown)

    def __getitem__(self, name: str) -> Any:
        """viser's handle of an object. Raises KeyError for an unknown name."""
        return self._shown[name].handle

    def frame(self, name: str, T: Floats | None = None, visible: bool | None = None, axes: float = 0.0) -> None:
        """Sets the frame of the objects below `name`: (4, 4) T_parent_frame; `axes` (m) is the length of drawn axes."""
        shown = self._shown.get(name)
        if shown is None:
            handle = self.server.scene.add_frame(
                name, show_axes=axes > 0, axes_length=axes, axes_radius=axes / 12, origin_radius=axes / 6
            )
            shown = self._shown[name] = _Shown(handle, ())
        if T is not None:
            self._move(shown, T)
        if visible is not None and shown.handle.visible != visible:
            shown.handle.visible = visible

    def lines(self, name: str, ends: Floats, colour: Colour | NDArray[np.uint8], width: float = 2.0) -> None:
        """Shows segments (N, 2, 3), in one colour or colours (N, 2, 3); `width` in pixels."""
        self._show(name, (ends, colour, width), lambda: self.server.scene.add_line_segments(
            name, ends, colour, thickness=width, thickness_units="screen"
        ) if len(ends) else None)  # fmt: skip

    def mesh(self, name: str, mesh: Mesh, colour: Colour, opacity: float) -> None:
        """Shows triangles, visible from both sides."""
        self._show(name, (*mesh, colour, opacity), lambda: self.server.scene.add_mesh_simple(
            name, *mesh, color=colour, opacity=opacity, side="double", flat_shading=True,
            cast_shadow=False, receive_shadow=False,
        ) if len(mesh[1]) else None)  # fmt: skip

    def points(
        self, name: str, points: NDArray[np.floating], colours: NDArray[np.uint8] | Colour, T: Floats | None = None,
        size: float = 0.04,
    ) -> None:  # fmt: skip
        """Shows points (N, 3) with one colour or colours (N, 3), in the frame at `T` (4, 4); `size` in metres."""
        self._show(name, (points, colours, size), lambda: self.server.scene.add_point_cloud(
            name, points, colours, point_size=size, point_shape="circle", point_shading="flat"
        ) if len(points) else None)  # fmt: skip
        if T is not None and name in self._shown:
            self._move(self._shown[name], T)

    def label(self, name: str, text: str, place: Floats) -> None:
        """Shows a line of text at a position (3,)."""
        self._show(name, (text, place), lambda: self.server.scene.add_label(
            name, text, position=place, anchor="center-center", font_screen_scale=0.7
        ))  # fmt: skip

    def set_camera(self, at: Floats, place: Floats) -> None:
        """Places the camera of all present and future clients at `place` (3,), looking at `at` (3,)."""
        self.server.initial_camera.look_at, self.server.initial_camera.position = at, place
        for client in self.server.get_clients().values():
            client.camera.look_at, client.camera.position = at, place

    def remove(self, name: str) -> None:
        """Removes an object and all objects below it."""
        below = [n for n in self._shown if n == name or n.startswith(name + "/")]
        for one in sorted(below, reverse=True):  # children first
            self._shown.pop(one).handle.remove()

    def hide(self, name: str, hidden: bool) -> None:
        """Hides an object or shows it again."""
        shown = self._shown.get(name)
        if shown is not None and shown.handle.visible == hidden:
            shown.handle.visible = not hidden

    def _show(self, name: str, content: tuple[Any, ...], add: Any) -> None:
        shown = self._shown.get(name)
        if shown is not None and _same(shown.content, content):
            return
        visible = shown is None or shown.handle.visible
        handle = add()
        if handle is None:
            if shown is not None:
                self.remove(name)
            return
        self._shown[name] = _Shown(handle, content)
        if not visible:
            handle.visible = False

    @staticmethod
    def _move(shown: _Shown, T: Floats) -> None:
        if shown.pose is not None and np.abs(shown.pose - T).max() < _STILL:
            return
        x, y, z, qx, qy, qz, qw = poses_to_xyzquat(T[None])[0].tolist()
        shown.handle.position, shown.handle.wxyz, shown.pose = (x, y, z), (qw, qx, qy, qz), T.copy()


def _same(a: tuple[Any, ...], b: tuple[Any, ...]) -> bool:
    return len(a) == len(b) and all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))


def _start_server(host: str, port: int, title: str) -> "viser.ViserServer":
    try:
        import viser
    except ImportError:
        raise UserError("viser is not installed, which the browser page needs; pip install 'sgslam[view]'") from None
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as trial:
        trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as the server does: old connections may linger
        try:
            trial.bind((host, port))  # viser would silently take another port
        except OSError as error:
            what = f"cannot listen on {host}:{port} ({error.strerror})"
            raise UserError(f"{what}; give another port, such as {port % 65535 + 1}, or 0 for any") from None
    with contextlib.redirect_stdout(io.StringIO()):  # we print the address ourselves
        server = viser.ViserServer(host, port, title, verbose=False)
    server.gui.configure_theme(control_width="large", show_logo=False, show_share_button=False)
    return server


def serve_until_interrupted(page: "Page") -> None:
    """Serves a page until the user presses Ctrl-C."""
    print(f"view: {page.url} (Ctrl-C to stop)", flush=True)
    try:
        threading.Event().wait()
    except KeyboardInterrupt:
        print(file=sys.stderr)
    page.close()
