"""As built against as planned: how far each matched wall lies from its place in the plan, and how sure that is."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data import WallSurface
from sgslam.config import Config
from sgslam.holding import Held, Holding
from sgslam.scene import Scene
from sgslam.uncertainty import Uncertainty
from sgslam.wall_map import WallMap

Floats = NDArray[np.float64]
_HEIGHT = 1.2  # m above the storey's floor, where offsets are measured
_COPLANAR = 0.02  # m
_OVER_PARAPET = 0.6  # m above the floor; what is never seen lower stands over something: a pane over its parapet
_NICHE = (-0.35, -0.03)  # m that a pane may stand behind its wall
_ONE_OFFSET = 0.05  # m between pieces of a wall that are off by the same
_STANDS = {True: 0.5, False: 0.35}  # of a wall's length that make it stand as planned, against pieces before, behind
_LEAST_SEEN = 0.45  # m of a wall that must be seen to stand otherwise, before it is said that the wall does
_LEAST_LOW = 0.5  # m of a wall that is seen low
_SHORT = 1.0, 0.02  # m and rad; what is shorter and turned more than this is badly seen


@dataclass(frozen=True)
class Piece:
    """A seen wall surface at its planned one. `offset` (m) along the planned inward normal, with its `sigma`, the
    matched wall's own anchor left out; `tilt` (rad) in plan view; `over_parapet`: never seen low."""

    held: Held
    offset: float
    sigma: float
    tilt: float
    over_parapet: bool

    @property
    def length(self) -> float:
        """Metres."""
        return self.held.surface.length or 0.0

    @property
    def doubtful(self) -> bool:
        """Whether it is too short and too skew to be told from what stands beside it."""
        return self.length < _SHORT[0] and abs(self.tilt) > _SHORT[1]


def measured_pieces(
    holding: Holding, scene: Scene, walls: WallMap, uncertainty: Uncertainty, origin: Floats, config: Config
) -> list[Piece]:
    """What the final graph says of each wall that stands at a planned one.

    The sigma is the graph's own, of the wall in the BIM frame, the scatter of its observations, and the extraction's
    floor. `origin` (3,) is where the graph's BIM frame, which stands on the storey's floor, lies in the BIM's.
    """
    scatter, lows = walls.scatter(), walls.lower_ends()
    tight: dict[int, int] = {}
    for held in holding.walls:
        wall = scene.wall_of_surface[held.surface.id]
        tight[wall] = tight.get(wall, 0) + held.agrees
    pieces = []
    for held in holding.walls:
        if held.bent or not uncertainty.knows(scene.wall_of_surface[held.surface.id]):
            continue
        wall, normal = scene.wall_of_surface[held.surface.id], np.array([*held.planned.normal, 0.0])
        centre = np.array([*held.planned.centroid, 0.0]) - origin
        point = np.array([*_along(held, holding.place, centre), _HEIGHT])
        offset, variance = uncertainty.wall_offset(wall, np.array([*normal[:3], -normal @ centre]), point)
        offset, variance = _without_anchor(offset, variance, tight[wall] if held.agrees else 0, config)
        sigma = float(np.sqrt(variance + scatter.get(wall, 0.0) ** 2 + config.anchors.sigma_extraction**2))
        low = lows.get(wall, 0.0)
        pieces.append(Piece(held, offset, sigma, _tilt(held, holding.place), low > _OVER_PARAPET))
    return pieces


def significant(pieces: list[Piece], config: Config) -> list[bool]:
    """Which of the pieces show that their wall stands otherwise than planned.

    A wall is judged by all of its pieces that turn to one side: where a good part of it stands as planned, it does,
    and what lies behind is a pane in its niche, what stands before is furniture. What is only seen over a parapet
    tells of the wall only where no other piece does, and nothing where it lies behind: it may be a pane.
    """
    flags = [False] * len(pieces)
    for face in _faces(pieces):
        limit = {i: max(config.anchors.tolerance, 3 * pieces[i].sigma) for i in face}
        telling = _telling([i for i in face if not pieces[i].doubtful], pieces)
        total = sum(pieces[i].length for i in telling)
        off = [i for i in telling if abs(pieces[i].offset) > limit[i]]
        if not off:
            continue
        middle = _median([pieces[i].offset for i in off], [pieces[i].length for i in off])
        standing = total - sum(pieces[i].length for i in off)
        if standing >= _STANDS[middle > 0] * total or total - standing < _LEAST_SEEN:
            continue
        for i in face:
            flags[i] = abs(pieces[i].offset) > limit[i] and abs(pieces[i].offset - middle) < _ONE_OFFSET
    return flags


def _faces(pieces: list[Piece]) -> list[list[int]]:
    """The pieces of one side of one wall, together."""
    faces: list[list[int]] = []
    for i, piece in enumerate(pieces):
        own = next((f for f in faces if _one_face(pieces[f[0]].held.planned, piece.held.planned)), None)
        if own is None:
            faces.append([i])
        else:
            own.append(i)
    return faces


def _telling(face: list[int], pieces: list[Piece]) -> list[int]:
    """Those pieces of one side of a wall that can only be the wall."""
    low = [i for i in face if not pieces[i].over_parapet]
    if sum(pieces[i].length for i in low) >= _LEAST_LOW:
        return low
    return [i for i in face if not (pieces[i].over_parapet and _NICHE[0] < pieces[i].offset < _NICHE[1])]


def moved(pieces: list[Piece], config: Config) -> list[dict[str, Any]]:
    """The entries of deviations.json of the walls that stand at a planned one."""
    return [
        {
            "s_id": piece.held.surface.id, "a_id": piece.held.planned.id, "source": piece.held.planned.source,
            "kind": "moved", "offset_m": piece.offset, "tilt_rad": piece.tilt, "sigma_m": piece.sigma,
            "significant": flag,
        }
        for piece, flag in zip(pieces, significant(pieces, config), strict=True)
    ]  # fmt: skip


def _without_anchor(offset: float, variance: float, anchors: int, config: Config) -> tuple[float, float]:
    """The estimate before the wall's own anchors, which said that it stands as planned, were fused into it."""
    settings = config.anchors
    information = 1 / max(variance, 1e-12)
    weight = anchors / settings.sigma_offset**2
    weight /= (1 + (offset / (settings.sigma_offset * settings.redescending)) ** 2) ** 2
    left = max(information - weight, 0.1 * information)
    return offset * information / left, 1 / left


def _along(held: Held, place: Floats, centre: Floats) -> Floats:
    """(2,) the planned wall's point that is nearest to the middle of the seen one, local frame."""
    c, s = np.cos(place[0]), np.sin(place[0])
    x, y = held.surface.centroid
    seen = np.array([c * x - s * y, s * x + c * y]) + place[1:]
    n = np.array(held.planned.normal)
    return np.asarray(seen - ((seen - centre[:2]) @ n) * n)


def _tilt(held: Held, place: Floats) -> float:
    (x, y), (nx, ny) = held.surface.normal, held.planned.normal
    turn = np.arctan2(y, x) + place[0] - np.arctan2(ny, nx)
    return float((turn + np.pi) % (2 * np.pi) - np.pi)


def _one_face(a: WallSurface, b: WallSurface) -> bool:
    if a.id == b.id:
        return True
    if not a.source or a.source != b.source:
        return False
    n = np.array(a.normal)
    return bool(n @ b.normal > 0.999 and abs(np.subtract(b.centroid, a.centroid) @ n) < _COPLANAR)


def _median(values: list[float], weights: list[float]) -> float:
    order = np.argsort(values, kind="stable")
    total = np.cumsum(np.asarray(weights)[order])
    return float(np.asarray(values)[order][np.searchsorted(total, total[-1] / 2)])
