"""Which end of a building's vertical is up, from its surfaces.

Each cue is a log odds (natural logarithm) and changes sign with the axis; the weights are near those of a
logistic regression over simulated walks through a dozen buildings. A bare closed room looks the same upside down.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sgslam.tracking.gravity_cues import LEVEL, UPRIGHT, Floats, UprightView, quantiles

Flags = NDArray[np.bool_]
Ints = NDArray[np.int64]

LOWEST_FLOOR, HIGHEST_FLOOR = 2.6, 0.2  # m below the sensor; of ceilings above it
LEAST_FLOOR = 0.01  # share of all surfels
BAND = 0.6  # m: walls are compared this far above the floor and below the ceiling; doors are 2 m high
CELL = 0.5  # m
PLANE = 0.3  # m: walls nearer to each other are one
GAP_BAND = 0.8  # m
NARROWEST_GAP, WIDEST_GAP = 0.8, 2.2  # m between the middles of the surfels at both sides of a door
SLOPING = 0.3, 0.95  # of a normal's z: 18 to 72 degrees from level
NEARLY_LEVEL = 0.3  # m from the sensor's height: neither above nor below
HIDDEN = 0.5  # m: what stands so much nearer hides a place; what is so much farther is seen through it
BIN = 4.0  # degrees, of the sensor's panorama
VIEWPOINTS = 5  # of the way
FEW = 3.0  # surfels: fewer are no evidence
FEW_GAPS = 1.0
MOST = 2.0  # log odds: the cues are not independent, and after 10 s one drive in five looks upside down by them


@dataclass(frozen=True)
class _Storey:
    """Heights (m) of floor and ceiling, and whether they were seen as such; else the lowest and highest points."""

    floor: float
    ceiling: float
    has_floor: bool
    has_ceiling: bool


def sign_log_odds(view: UprightView) -> float:
    """Above zero, the view's z axis points up rather than down."""
    return float(np.clip(WEIGHTS @ sign_cues(view), -MOST, MOST))


# 1. Floors go on through doorways; of ceilings the door heads hide the rest.
# 2. Walls are whole under the ceiling; above the floor they are hidden by furniture and interrupted by doors.
# 3. There one sees farther than the wall.
# 4. A gap between two pieces of one wall, through which one sees farther, reaches the floor and not the ceiling.
# 5. Roofs and the undersides of stairs face down; hardly anything large faces up at a slope.
# 6. Tables, seats and sills face up between floor and ceiling; what faces down there is narrow.
# 7. A sensor is carried some 1.3 m above the floor; a ceiling may be farther.
WEIGHTS = np.array([0.6, 0.95, 0.65, 1.0, 1.25, 0.4, 0.7])


def sign_cues(view: UprightView) -> Floats:
    """(7,) the cues of `WEIGHTS`."""
    storey = _storey_of(view)
    panorama = _Panorama(view)
    one_sided = [_gaps(view, storey, panorama), _slopes(view), _middle_heights(view, storey)]
    if not (storey.has_floor and storey.has_ceiling):  # the sensor looks up or down; its view compares nothing
        return np.array([0.0, 0.0, 0.0, *one_sided, 0.0])
    walls, through = _interrupted_walls(view, storey, panorama)
    return np.array([_seen_levels(view, storey, panorama), walls, through, *one_sided, _height(storey)])


def _storey_of(view: UprightView) -> _Storey:
    z, n = view.positions[:, 2], view.normals[:, 2]
    low, high = quantiles(z, view.weights)
    floor = _peak(-z[n > LEVEL], view.weights[n > LEVEL], view.weights.sum())
    ceiling = _peak(z[n < -LEVEL], view.weights[n < -LEVEL], view.weights.sum())
    return _Storey(
        low if floor is None else -floor, high if ceiling is None else ceiling, floor is not None, ceiling is not None
    )


def _peak(distance: Floats, weights: Floats, total: float) -> float | None:
    """The distance (m) from the sensor at which most level surfaces lie; None where hardly any do."""
    near = (distance > HIGHEST_FLOOR) & (distance < LOWEST_FLOOR)
    if weights[near].sum() < LEAST_FLOOR * total:
        return None
    heights, edges = np.histogram(
        distance[near], np.arange(HIGHEST_FLOOR, LOWEST_FLOOR + 0.15, 0.1), weights=weights[near]
    )
    return float(edges[np.argmax(heights[:-1] + heights[1:]) + 1])


class _Panorama:
    """The nearest surfel in each direction, from some places of the way."""

    def __init__(self, view: UprightView) -> None:
        chosen = np.linspace(0, len(view.sensors) - 1, VIEWPOINTS).astype(int)
        self._from = view.sensors[chosen]
        self._columns, self._rows = round(360 / BIN), round(180 / BIN)
        self._nearest = np.full((VIEWPOINTS, self._columns * self._rows), np.inf)
        ranges, bins = self._directions(view.positions)
        for nearest, r, b in zip(self._nearest, ranges, bins, strict=True):
            np.minimum.at(nearest, b, r)

    def look(self, places: Floats) -> tuple[Flags, Flags]:
        """(N,) whether something hides the places (N, 3), and whether one sees through them, from any viewpoint."""
        ranges, bins = self._directions(places)
        nearest = np.take_along_axis(self._nearest, bins, axis=1)
        beyond = np.isfinite(nearest) & (nearest > ranges + HIDDEN)
        return np.any(nearest < ranges - HIDDEN, axis=0), np.any(beyond, axis=0)

    def _directions(self, places: Floats) -> tuple[Floats, Ints]:
        """(VIEWPOINTS, N) distances and bins."""
        rays = places - self._from[:, None]
        ranges = np.maximum(np.linalg.norm(rays, axis=2), 1e-6)
        column = ((np.arctan2(rays[..., 1], rays[..., 0]) / (2 * np.pi) + 0.5) * self._columns).astype(np.int64)
        row = (np.arccos(np.clip(rays[..., 2] / ranges, -1.0, 1.0)) / np.pi * self._rows).astype(np.int64)
        return ranges, column % self._columns * self._rows + np.minimum(row, self._rows - 1)


def _more(ups: float, downs: float) -> float:
    return float(np.log((ups + FEW) / (downs + FEW)))


def _alone(
    view: UprightView, panorama: _Panorama, key: Ints, here: Flags, there: Flags, height: float
) -> tuple[float, float]:
    """Of the surfels `here` without one `there` in the same cell: at how many the place at that height is hidden, and
    seen through. What the sensor cannot see at all counts for nothing.
    """
    places = view.positions[here & ~np.isin(key, key[there])]
    if not len(places):
        return 0.0, 0.0
    hidden, through = panorama.look(np.column_stack([places[:, :2], np.full(len(places), height)]))
    return float(hidden.sum()), float(through.sum())


def _seen_levels(view: UprightView, storey: _Storey, panorama: _Panorama) -> float:
    z, n = view.positions[:, 2], view.normals[:, 2]
    floor = (n > LEVEL) & (np.abs(z - storey.floor) < 0.15)
    ceiling = (n < -LEVEL) & (np.abs(z - storey.ceiling) < 0.15)
    cells = np.floor(view.positions[:, :2] / CELL).astype(np.int64) @ np.array([1 << 20, 1])
    above, _ = _alone(view, panorama, cells, floor, ceiling, storey.ceiling)
    below, _ = _alone(view, panorama, cells, ceiling, floor, storey.floor)
    return _more(above, below)


def _interrupted_walls(view: UprightView, storey: _Storey, panorama: _Panorama) -> tuple[float, float]:
    z = view.positions[:, 2]
    wall = np.abs(view.normals[:, 2]) < UPRIGHT
    top = wall & (z > storey.ceiling - BAND) & (z < storey.ceiling)
    foot = wall & (z < storey.floor + BAND) & (z > storey.floor)
    plane, along = _walls(view)
    columns = plane * (1 << 20) + np.floor(along / CELL).astype(np.int64)  # pieces of wall over their whole height
    open_foot, through_foot = _alone(view, panorama, columns, top, foot, storey.floor + BAND / 2)
    open_top, through_top = _alone(view, panorama, columns, foot, top, storey.ceiling - BAND / 2)
    return _more(open_foot, open_top), _more(through_foot, through_top)


def _gaps(view: UprightView, storey: _Storey, panorama: _Panorama) -> float:
    z = view.positions[:, 2]
    wall = np.abs(view.normals[:, 2]) < UPRIGHT
    foot = wall & (z > storey.floor) & (z < storey.floor + GAP_BAND)
    top = wall & (z < storey.ceiling) & (z > storey.ceiling - GAP_BAND)
    below = _open_gaps(view, foot, storey.floor + GAP_BAND / 2, panorama) if storey.has_floor else 0
    above = _open_gaps(view, top, storey.ceiling - GAP_BAND / 2, panorama) if storey.has_ceiling else 0
    return float(np.log((below + FEW_GAPS) / (above + FEW_GAPS)))


def _open_gaps(view: UprightView, band: Flags, height: float, panorama: _Panorama) -> int:
    """How many gaps between surfels of one wall within the band are as wide as a door and seen through."""
    plane, along = _walls(view)
    plane, along, places = plane[band], along[band], view.positions[band]
    order = np.lexsort((along, plane))
    width = np.diff(along[order])
    gap = (np.diff(plane[order]) == 0) & (width > NARROWEST_GAP) & (width < WIDEST_GAP)
    if not gap.any():
        return 0
    middles = (places[order][:-1][gap] + places[order][1:][gap]) / 2
    middles[:, 2] = height
    return int(panorama.look(middles)[1].sum())


def _walls(view: UprightView) -> tuple[Ints, Floats]:
    """(N,) a number for the plane and side of each upright surfel, and its place along the wall in metres."""
    n = view.normals
    across_x = np.abs(n[:, 0]) > np.abs(n[:, 1])
    side = np.where(across_x, n[:, 0], n[:, 1]) > 0
    offset = np.where(across_x, view.positions[:, 0], view.positions[:, 1])
    along = np.where(across_x, view.positions[:, 1], view.positions[:, 0])
    return np.round(offset / PLANE).astype(np.int64) * 4 + 2 * across_x + side, along


def _slopes(view: UprightView) -> float:
    z, n = view.positions[:, 2], view.normals[:, 2]
    sloping = (np.abs(n) > SLOPING[0]) & (np.abs(n) < SLOPING[1])
    above, below = sloping & (n < 0) & (z > NEARLY_LEVEL), sloping & (n > 0) & (z < -NEARLY_LEVEL)
    return _more(view.weights[above].sum(), view.weights[below].sum())


def _middle_heights(view: UprightView, storey: _Storey) -> float:
    z, n = view.positions[:, 2], view.normals[:, 2]
    middle = (z > storey.floor + 0.25) & (z < storey.ceiling - 0.25)
    return _more(view.weights[middle & (n > LEVEL)].sum(), view.weights[middle & (n < -LEVEL)].sum())


def _height(storey: _Storey) -> float:
    return _carried(-storey.floor) - _carried(storey.ceiling)


def _carried(height: float) -> float:
    """The log density of a sensor's height above the floor: 1.3 m, give or take 0.5, and others now and then."""
    return float(np.logaddexp(-(((height - 1.3) / 0.5) ** 2) / 2, -4.0))
