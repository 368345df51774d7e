"""Which earlier keyframes and rooms are similar: as far from wall to wall, in two directions, as here.

The distance between two walls that face each other does not depend on where between them the sensor stands, nor on the
map's drift: a room is told by its width and depth, a corridor by nothing but its width.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sgslam.mapping.scene import Scene

Floats = NDArray[np.float64]
Index = NDArray[np.int64]
_EQUAL = 0.08  # m between two distances that are taken for the same
_PARALLEL = 0.99  # cosine between the normals of two walls that face each other
_ALIGNED = 0.95  # cosine between directions in the map, which turns a little as it drifts
_BOTH = 0.5  # of the worst direction's equal distances: two parallel ones are no second direction
_LEAST, _MOST = 0.5, 20.0  # m from wall to wall


@dataclass(frozen=True)
class Widths:
    """Distances (N,) m between walls that face each other, in directions (N, 3), each with its `owner` (N,), a keyframe
    or a room, in whose frame it is unless told otherwise."""

    owner: Index
    direction: Floats
    distance: Floats

    @staticmethod
    def of(owner: int, planes: Floats) -> "Widths":
        """Between upright planes (M, 4), normals towards the side seen."""
        facing = planes[:, :3] @ planes[:, :3].T < -_PARALLEL
        apart = planes[:, None, 3] + planes[None, :, 3]  # n.x + d = 0, opposite normals
        first, second = np.nonzero(np.triu(facing & (apart > _LEAST) & (apart < _MOST)))
        return Widths(np.full(len(first), owner, dtype=np.int64), planes[first, :3], apart[first, second])

    @staticmethod
    def together(parts: "list[Widths]") -> "Widths":
        """All of them."""
        if not parts:
            return Widths(np.empty(0, np.int64), np.empty((0, 3)), np.empty(0))
        return Widths(
            np.concatenate([p.owner for p in parts]), np.concatenate([p.direction for p in parts]),
            np.concatenate([p.distance for p in parts]),
        )  # fmt: skip

    def turned(self, T_level_owner: Floats) -> "Widths":
        """The same with directions in the levelled map; `T_level_owner` (K, 4, 4) are the poses of all owners."""
        turned = np.einsum("nij,nj->ni", T_level_owner[self.owner, :3, :3], self.direction)
        return Widths(self.owner, turned, self.distance)

    def by(self, owner: int) -> "Widths":
        """Those of one owner."""
        own = self.owner == owner
        return Widths(self.owner[own], self.direction[own], self.distance[own])


def similar(here: Widths, known: Widths) -> Index:
    """The owners of `known` distances that equal those of `here` in two horizontal directions, without repetition; all
    directions in the levelled map."""
    if not len(here.distance) or not len(known.distance):
        return np.empty(0, dtype=np.int64)
    equal = np.abs(here.distance[:, None] - known.distance[None]) < _EQUAL
    equal &= np.abs(here.direction[:, :2] @ known.direction[:, :2].T) > _ALIGNED
    owners, column = np.unique(known.owner, return_inverse=True)
    found = np.zeros((len(here.distance), len(owners)))
    rows, columns = np.nonzero(equal)
    found[rows, column[columns]] = 1.0
    xx, xy, yy = (found.T @ (here.direction[:, a] * here.direction[:, b]) for a, b in ((0, 0), (0, 1), (1, 1)))
    return owners[(xx + yy) / 2 - np.hypot((xx - yy) / 2, xy) > _BOTH]


def similar_rooms(scene: Scene) -> dict[int, list[int]]:
    """For each keyframe in a room the keyframes of other rooms that are similar to it in width and depth."""
    rooms = {room.id: room for room in scene.rooms if room.walls}
    number_of = {name: number for number, name in scene.room_ids.items()}
    members: dict[int, list[int]] = {}
    for keyframe in scene.graph.keyframes:
        number = number_of.get(keyframe.room or "")
        if number in rooms:
            members.setdefault(number, []).append(int(keyframe.id.removeprefix("k")))
    widths = [Widths.of(k, np.stack(list(room.walls.values()))) for k, room in rooms.items()]
    known = Widths.together(widths)
    result: dict[int, list[int]] = {}
    for number, own in zip(rooms, widths, strict=True):
        same = [k for other in similar(own, known).tolist() if other != number for k in members.get(other, [])]
        if same:
            result |= dict.fromkeys(members.get(number, []), sorted(same))
    return result
