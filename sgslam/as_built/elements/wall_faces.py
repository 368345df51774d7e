"""Which mapped surfaces belong to one wall: its two faces, and pieces of one line."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from data.scene_graph import Xy

_PARALLEL = 0.1  # rad between the faces of one wall
_IN_LINE = 0.1  # m across, between pieces of one face
_THICK = 0.45  # m between both faces of a wall
_GAP = 1.2  # m along, between pieces of one face; a door is narrower
_OVERLAP = 0.1  # m along, that both faces share at least


@dataclass(frozen=True)
class Face:
    """A mapped surface, in the BIM frame, in metres; `normal` (x, y) points to where it was seen from."""

    id: str
    floor: str
    ends: tuple[Xy, Xy]
    normal: Xy
    height: tuple[float, float]
    reason: str

    @property
    def length(self) -> float:
        """m, in plan view."""
        return float(np.linalg.norm(np.subtract(*self.ends)))


def one_wall_each(faces: Sequence[Face]) -> list[list[Face]]:
    """The faces by the wall that they show; the walls in the order of their first faces."""
    walls: list[list[Face]] = []
    for face in faces:
        same = [wall for wall in walls if any(_same_wall(face, other) for other in wall)]
        joined = [*(other for wall in same for other in wall), face]
        at = next((k for k, wall in enumerate(walls) if wall in same), len(walls))
        walls = [*walls[:at], joined, *(wall for wall in walls[at:] if wall not in same)]
    return walls


def _same_wall(a: Face, b: Face) -> bool:
    """Whether two faces are pieces of one line, or back to back no further apart than a wall is thick."""
    n = np.array(a.normal)
    facing = float(n @ b.normal)
    if abs(facing) < np.cos(_PARALLEL):
        return False
    tangent = np.array([-n[1], n[0]])
    one, other = (np.sort(np.array(face.ends) @ tangent) for face in (a, b))
    gap = max(one[0], other[0]) - min(one[1], other[1])
    across = float(np.subtract(np.mean(b.ends, axis=0), np.mean(a.ends, axis=0)) @ n)
    if facing > 0:
        return abs(across) < _IN_LINE and gap < _GAP
    return -_THICK < across < _IN_LINE and gap < -_OVERLAP
