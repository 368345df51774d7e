"""A page in the browser (viser) with named 3D objects."""

import atexit
import contextlib
import io
import re
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.geometry.poses import poses_to_xyzquat
from sgslam.viewer.canvas import Canvas

if TYPE_CHECKING:
    import viser

Floats = NDArray[np.float64]
HOST, PORT = "127.0.0.1", 8080


def parse_address(text: str) -> tuple[str, int]:
    """Parses `[HOST:]PORT`. Raises UserError if it is invalid."""
    host, _, port = text.rpartition(":")
    if not re.fullmatch(r"\d{1,5}", port) or int(port) > 65535:
        raise UserError(f"{text}: not a port; give PORT or HOST:PORT, such as {PORT} or 0.0.0.0:{PORT}")
    return host or HOST, int(port)


class Page(Canvas):
    """A page in the browser. `server` is viser's, with its `gui` and `scene`; `url` is the page's address."""

    def __init__(self, at: tuple[str, int] = (HOST, PORT)) -> None:
        """Opens the page; port 0 takes any free port. Raises UserError if viser is missing or the port is in use."""
        super().__init__()
        self.server = _start_server(*at)
        host = "localhost" if at[0] in ("0.0.0.0", "::", HOST) else at[0]
        self.url = f"http://{host}:{self.server.get_port()}"
        self._handles: dict[str, Any] = {}
        atexit.register(self.close)
        self._lock = threading.RLock()  # one thread draws, others handle the controls

    def clear(self) -> None:
        """Removes all objects and controls."""
        with self._lock:
            for name in {name.split("/")[1] for name in self.names}:
                self.remove(f"/{name}")
            self.server.gui.reset()

    def close(self) -> None:
        atexit.unregister(self.close)
        with contextlib.redirect_stdout(io.StringIO()):
            self.server.stop()

    @contextmanager
    def atomic(self) -> Iterator[None]:
        """Context in which all changes are sent together and no other thread makes changes."""
        with self._lock, self.server.atomic():
            yield

    def __getitem__(self, name: str) -> Any:
        """viser's handle of an object. Raises KeyError for an unknown name."""
        return self._handles[name]

    def set_camera(self, at: Floats, place: Floats) -> None:
        """Places the camera of all present and future clients at `place` (3,), looking at `at` (3,)."""
        for camera in (self.server.initial_camera, *(own.camera for own in self.server.get_clients().values())):
            camera.look_at, camera.position = at, place

    def draw(self, kind: str, name: str, *content: Any) -> None:
        scene = self.server.scene
        if kind == "frame":
            (axes,) = content
            sizes = {"axes_length": axes, "axes_radius": axes / 12, "origin_radius": axes / 6}
            handle: Any = scene.add_frame(name, show_axes=axes > 0, **sizes)
        elif kind == "lines":
            ends, colour, width = content
            handle = scene.add_line_segments(name, ends, colour, thickness=width, thickness_units="screen")
        elif kind == "mesh":
            triangles, colour, opacity = content
            vertices, faces = triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3)
            looks: dict[str, Any] = {"side": "double", "flat_shading": True, "cast_shadow": False}
            looks |= {"color": colour, "opacity": opacity, "receive_shadow": False}
            handle = scene.add_mesh_simple(name, vertices, faces, **looks)
        elif kind == "points":
            points, colours, size = content
            looks = {"point_shape": "circle", "point_shading": "flat"}
            handle = scene.add_point_cloud(name, points, colours, point_size=size, **looks)
        else:
            text, place = content
            handle = scene.add_label(name, text, position=place, anchor="center-center", font_screen_scale=0.7)
        if name in self._handles and not self._handles[name].visible:
            handle.visible = False
        self._handles[name] = handle

    def move(self, name: str, T: Floats) -> None:
        x, y, z, qx, qy, qz, qw = poses_to_xyzquat(T[None])[0].tolist()
        self._handles[name].position, self._handles[name].wxyz = (x, y, z), (qw, qx, qy, qz)

    def erase(self, name: str) -> None:
        self._handles.pop(name).remove()

    def hide(self, name: str, hidden: bool) -> None:
        """Hides an object or shows it again; one that is not there has nothing to hide."""
        if name in self._handles and self._handles[name].visible == hidden:
            self._handles[name].visible = not hidden


def _start_server(host: str, port: int) -> "viser.ViserServer":
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
        server = viser.ViserServer(host, port, "sgslam", verbose=False)
    server.gui.configure_theme(control_width="large", show_logo=False, show_share_button=False)
    return server


def serve_until_interrupted(page: "Page") -> None:
    print(f"view: {page.url} (Ctrl-C to stop)", flush=True)
    try:
        threading.Event().wait()
    except KeyboardInterrupt:
        print(file=sys.stderr)
    page.close()
