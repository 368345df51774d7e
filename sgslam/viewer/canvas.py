"""Named 3D objects in nested frames, on a page or in a recording; only changes are drawn."""

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Colour = tuple[int, int, int]


def rgb(text: str) -> Colour:
    return int(text[1:3], 16), int(text[3:5], 16), int(text[5:7], 16)


class Canvas(ABC):
    """The frames above an object come by themselves; an object without content is removed.

    All positions are relative to `origin` (3,): drawing is in single precision, and sites lie kilometres from zero.
    """

    def __init__(self) -> None:
        self.origin = np.zeros(3)
        self._contents: dict[str, tuple[Any, ...]] = {}
        self._poses: dict[str, Floats] = {}

    @property
    def names(self) -> frozenset[str]:
        """The names of all objects, shown or hidden."""
        return frozenset(self._contents)

    def frame(self, name: str, T: Floats | None = None, axes: float = 0.0) -> None:
        """Sets the frame of the objects below `name`: (4, 4) T_parent_frame; `axes` (m) is the length of drawn axes."""
        if name not in self._contents:
            self._show("frame", name, True, axes)
        if T is not None:
            self._move(name, T)

    def lines(self, name: str, ends: Floats, colour: Colour, width: float = 2.0) -> None:
        """Shows segments (N, 2, 3); `width` in pixels."""
        self._show("lines", name, len(ends) > 0, ends, colour, width)

    def mesh(self, name: str, triangles: Floats, colour: Colour, opacity: float) -> None:
        """Shows triangles (T, 3, 3), visible from both sides."""
        self._show("mesh", name, len(triangles) > 0, triangles, colour, opacity)

    def points(
        self,
        name: str,
        points: NDArray[np.floating],
        colours: NDArray[np.uint8] | Colour,
        T: Floats,
        size: float = 0.04,
    ) -> None:
        """Shows points (N, 3) with one colour or colours (N, 3), in the frame at `T` (4, 4); `size` in metres."""
        self._show("points", name, len(points) > 0, points, colours, size)
        if name in self._contents:
            self._move(name, T)

    def label(self, name: str, text: str, place: Floats) -> None:
        """Shows a line of text at a position (3,)."""
        self._show("label", name, True, text, place)

    def remove(self, name: str) -> None:
        """Removes an object and all objects below it."""
        below = [own for own in self._contents if own == name or own.startswith(f"{name}/")]
        for own in sorted(below, reverse=True):  # children first
            del self._contents[own]
            self._poses.pop(own, None)
            self.erase(own)

    def _show(self, kind: str, name: str, is_there: bool, *content: Any) -> None:
        shown = self._contents.get(name)
        if not is_there:
            self.remove(name)
        elif shown is None or not all(np.array_equal(a, b) for a, b in zip(shown, content, strict=True)):
            above = name.rpartition("/")[0]
            if above and above not in self._contents:
                self.frame(above)
            self.draw(kind, name, *content)
            self._contents[name] = content
            self._poses.pop(name, None)

    def _move(self, name: str, T: Floats) -> None:
        if name not in self._poses or not np.allclose(self._poses[name], T, rtol=0.0, atol=1e-4):
            self.move(name, T)
            self._poses[name] = T.copy()

    @abstractmethod
    def draw(self, kind: str, name: str, *content: Any) -> None:
        """Adds or replaces an object: a `frame` (axes), `lines` (ends, colour, width), a `mesh` (triangles, colour,
        opacity), `points` (points, colours, size) or a `label` (text, place)."""

    @abstractmethod
    def move(self, name: str, T: Floats) -> None:
        """Sets the pose of an object in the frame above it."""

    @abstractmethod
    def erase(self, name: str) -> None:
        """Removes an object."""

    @abstractmethod
    def hide(self, name: str, hidden: bool) -> None:
        """Hides an object or shows it again."""
