"""Extra walls: mapped ones where the plan has none."""

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from data.scene_graph import WallSurface, Xy
from sgslam.anchoring import WallAlignment
from sgslam.as_built.deviation_entries import ExtraDeviation
from sgslam.as_built.mapped_walls import MappedWalls
from sgslam.as_built.visibility import MIN_KEYFRAMES, wall_visibility
from sgslam.as_built.wall_solids import Side
from sgslam.mapping import KeyframeNode, Scene, WallMap

Floats = NDArray[np.float64]
Stretch = tuple[int, float, float]  # a surface's number, and where along it, from its middle to the left (m)
_LEAST = 1.0  # m, of all stretches in one line
_LEAST_TALL = 0.75  # m, the same of a wall that is taller than cupboards
_LEAST_STRETCH = 0.5  # m
_LONGEST_LEAF = 1.3  # m; what is shorter and ends at a door may be its leaf, open
_HINGE = 0.75  # m from a door's middle
_NO_FURNITURE = 2.0  # m above the floor; cupboards end below
_HANGS = 1.3  # m above the floor; what is never seen lower hangs, or stands on another storey
_OPEN = 0.5  # of an extra wall's length that may be seen through; posts under a beam are no wall


def extra_walls(
    scene: Scene, walls: WallMap, keyframes: list[KeyframeNode], floor: SceneGraph, alignment: WallAlignment,
    origin: Floats,
) -> list[ExtraDeviation]:  # fmt: skip
    """The entries of deviations.json of mapped wall surfaces where the plan has none.

    Such a surface is seen from three keyframes or more, and with others in its line it is long. It is taller than
    cupboards, or its other side is seen too, as thin as a wall. No planned wall lies along it that it could be, and
    neither a planned nor a taller mapped one is behind it that it could be furniture of. The scans do not see through
    it. `origin` (2,) is the local frame's origin in the BIM frame.
    """
    mapped = MappedWalls.of(scene, walls, alignment, floor, origin)
    stretches = [
        (i, low, high)
        for i in range(len(mapped.surfaces)) if _is_wall(mapped, i)
        for low, high in mapped.unplanned_stretches(i) if high - low >= _LEAST_STRETCH
    ]  # fmt: skip
    doors = np.array([door.centroid for door in floor.doors]).reshape(-1, 2) - origin
    stretches = _closed(stretches, mapped, keyframes, walls, floor, alignment, origin)
    return [
        {
            "s_id": mapped.surfaces[i].id, "a_id": None, "source": "", "kind": "extra",
            "trace": _trace(mapped, (i, low, high), origin), "offset_m": None, "tilt_rad": None, "sigma_m": None,
            "significant": True, "reason": f"{high - low:.1f} m long, seen from {mapped.bottom[i]:.1f} "
            f"to {mapped.highest[i]:.1f} m above the floor",
        }
        for i, low, high in stretches
        if _in_line(mapped, i, stretches) >= _least(mapped, (i, low, high), doors)
    ]  # fmt: skip


def _is_wall(mapped: MappedWalls, i: int) -> bool:
    if mapped.surfaces[i].id in mapped.aligned or mapped.count[i] < MIN_KEYFRAMES or mapped.bottom[i] > _HANGS:
        return False
    if mapped.has_other_side(i):
        return True
    tall = mapped.top[i] >= _NO_FURNITURE or mapped.closes_a_room(i)
    return tall and not mapped.stands_before_another(i)


def _in_line(mapped: MappedWalls, i: int, stretches: list[Stretch]) -> float:
    """The length (m) of all stretches of the wall that surface i is of, as the map has it."""
    return sum(high - low for k, low, high in stretches if mapped.wall[k] == mapped.wall[i])


def _least(mapped: MappedWalls, stretch: Stretch, doors: Floats) -> float:
    """The least length (m) of all stretches in the line of this one."""
    if _at_door(mapped, stretch, doors):
        return _LONGEST_LEAF
    return _LEAST_TALL if mapped.top[stretch[0]] >= _NO_FURNITURE else _LEAST


def _at_door(mapped: MappedWalls, stretch: Stretch, doors: Floats) -> bool:
    """Whether an end of it is at one of the planned doors (K, 2, local frame), where the hinge of its leaf is."""
    ends = np.array(_trace(mapped, stretch, np.zeros(2)))
    return bool((np.linalg.norm(ends[:, None] - doors, axis=2) < _HINGE).any())


def _closed(
    stretches: list[Stretch], mapped: MappedWalls, keyframes: list[KeyframeNode], walls: WallMap, floor: SceneGraph,
    alignment: WallAlignment, origin: Floats,
) -> list[Stretch]:  # fmt: skip
    """The stretches that the scans do not see through."""
    sides = [_side(_trace(mapped, stretch, origin), mapped, stretch) for stretch in stretches]
    seen = wall_visibility(floor, sides, keyframes, walls.T_level_map, alignment.place, origin)
    return [
        stretch for side, stretch in zip(sides, stretches, strict=True)
        if side.key not in seen or seen[side.key].open <= _OPEN * seen[side.key].length
    ]  # fmt: skip


def _side(trace: tuple[Xy, Xy], mapped: MappedWalls, stretch: Stretch) -> Side:
    """A stretch as a side of a planned wall, in the BIM frame."""
    i, low, high = stretch
    half, (nx, ny) = (high - low) / 2, mapped.arrays.normal[i].tolist()
    x, y = np.mean(trace, axis=0).tolist()
    surface = WallSurface(f"{mapped.surfaces[i].id} {low:.2f}", None, (x, y), (nx, ny), 2 * half)
    return Side(surface, "", ((-half, half),), (-half, half))


def _trace(mapped: MappedWalls, stretch: Stretch, origin: Floats) -> tuple[Xy, Xy]:
    """The ends of a stretch in the BIM frame, the left one (looking along the normal) first."""
    i, low, high = stretch
    place, tangent = mapped.arrays.centre[i] + origin, mapped.tangent(i)
    (ax, ay), (bx, by) = (place + high * tangent).tolist(), (place + low * tangent).tolist()
    return (ax, ay), (bx, by)
