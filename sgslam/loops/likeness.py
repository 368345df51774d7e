"""Similar keyframes and rooms: those with equal distances from wall to wall in two directions.

The distance between two walls that face each other depends neither on the sensor's place between them nor on drift. A
room is described by its width and depth, a corridor only by its width.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sgslam.mapping import Scene

Floats = NDArray[np.float64]
Index = NDArray[np.int64]
_EQUAL = 0.08  # m between two distances that count as equal
_PARALLEL = 0.99  # cosine between the normals of two walls that face each other
_ALIGNED = 0.95  # cosine between directions in the map, which rotates a little as it drifts
_BOTH = 0.5  # equal distances needed in the weakest direction: two parallel ones are no second direction
_LEAST, _MOST = 0.5, 20.0  # m from wall to wall


@dataclass(frozen=True)
class Widths:
    """Distances (N,), in metres, between walls that face each other, along directions (N, 3).

    `owner` (N,) is the keyframe or room of each, in whose frame the direction is given unless stated otherwise.
    """

    owner: Index
    direction: Floats
    distance: Floats

    @staticmethod
    def of(owner: int, planes: Floats) -> "Widths":
        """Distances between upright planes (M, 4) with normals towards the observed side."""
        facing = planes[:, :3] @ planes[:, :3].T < -_PARALLEL
        apart = planes[:, None, 3] + planes[None, :, 3]  # n.x + d = 0, opposite normals
        first, second = np.nonzero(np.triu(facing & (apart > _LEAST) & (apart < _MOST)))
        return Widths(np.full(len(first), owner, dtype=np.int64), planes[first, :3], apart[first, second])

    @staticmethod
    def together(parts: "list[Widths]") -> "Widths":
        """Concatenates several."""
        if not parts:
            return Widths(np.empty(0, np.int64), np.empty((0, 3)), np.empty(0))
        return Widths(
            np.concatenate([p.owner for p in parts]), np.concatenate([p.direction for p in parts]),
            np.concatenate([p.distance for p in parts]),
        )  # fmt: skip

    def turned(self, T_level_owner: Floats) -> "Widths":
        """With directions in the levelled map; `T_level_owner` (K, 4, 4) are the poses of all owners."""
        turned = np.einsum("nij,nj->ni", T_level_owner[self.owner, :3, :3], self.direction)
        return Widths(self.owner, turned, self.distance)

    def by(self, owner: int) -> "Widths":
        """The distances of one owner."""
        own = self.owner == owner
        return Widths(self.owner[own], self.direction[own], self.distance[own])


def similar(here: Widths, known: Widths) -> Index:
    """The owners (M,), unique, of `known` distances that equal those of `here` in two horizontal directions.

    All directions are in the levelled map.
    """
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
    """For each keyframe in a room, the keyframes of other rooms with similar width and depth."""
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
