"""Which stretches of mapped surfaces belong to one wall: its two faces, and pieces of one line."""

from collections.abc import Sequence

import numpy as np

from sgslam.as_built.unplanned.stretches import Stretch
from sgslam.as_built.unplanned.unexplained import GRID
from sgslam.config.sensor import BUILDING

_PARALLEL = 0.1  # rad between the faces of one wall


def one_wall_each(stretches: Sequence[Stretch]) -> list[list[Stretch]]:
    """The stretches by the wall that they show; the walls in the order of their first ones."""
    walls: list[list[Stretch]] = []
    for stretch in stretches:
        same = [wall for wall in walls if any(_same_wall(stretch, other) for other in wall)]
        joined = [*(other for wall in same for other in wall), stretch]
        at = next((k for k, wall in enumerate(walls) if wall in same), len(walls))
        walls = [*walls[:at], joined, *(wall for wall in walls[at:] if wall not in same)]
    return walls


def is_two_sided(wall: Sequence[Stretch]) -> bool:
    """Whether a wall's stretches show both its faces."""
    return any(float(stretch.normal @ wall[0].normal) < 0 for stretch in wall)


def _same_wall(a: Stretch, b: Stretch) -> bool:
    """Whether two are pieces of one line, or back to back no further apart than a wall is thick."""
    n = a.normal
    facing = float(n @ b.normal)
    if abs(facing) < np.cos(_PARALLEL):
        return False
    tangent = np.array([-n[1], n[0]])
    one, other = (np.sort([own.first @ tangent, own.last @ tangent]) for own in (a, b))
    gap = max(one[0], other[0]) - min(one[1], other[1])
    across = float(((b.first + b.last) - (a.first + a.last)) @ n) / 2
    if facing > 0:
        return bool(abs(across) < GRID and gap < BUILDING.widest_door)
    return bool(-BUILDING.thickest_wall < across < GRID and gap < -GRID)
