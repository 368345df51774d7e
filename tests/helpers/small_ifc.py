"""A small building as an IFC file, made of boxes, with all that is solid in it known exactly.

In its own frame (metres, z = 0 on the floor of its storey):

    y 7  +-----------+-----------+
         |  Office   [   Store   |     one box of furniture in the store,
    y 3  +---| |-----+----| |----+     a window in the office's north wall
         |          Hall         |
    y 0  +-----------------------+
         x 0         5           10
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.ifc.writer import IfcWriter, box, placed

Box = tuple[float, float, float, float, float, float]  # lowest x y z, highest x y z

STOREY = "Ground"
HEIGHT = 2.6
ROOMS: dict[str, tuple[float, float, float, float]] = {  # lowest x y, highest x y
    "Hall": (0.0, 0.0, 10.0, 3.0),
    "Office": (0.0, 3.2, 4.9, 7.0),
    "Store": (5.1, 3.2, 10.0, 7.0),
}
WALLS: dict[str, Box] = {
    "south": (-0.2, -0.2, 0.0, 10.2, 0.0, HEIGHT),
    "north": (-0.2, 7.0, 0.0, 10.2, 7.2, HEIGHT),
    "west": (-0.2, 0.0, 0.0, 0.0, 7.0, HEIGHT),
    "east": (10.0, 0.0, 0.0, 10.2, 7.0, HEIGHT),
    "middle": (0.0, 3.0, 0.0, 10.0, 3.2, HEIGHT),
    "between": (4.9, 3.2, 0.0, 5.1, 7.0, HEIGHT),
}
DOORS: tuple[Box, ...] = ((2.0, 3.0, 0.0, 3.0, 3.2, 2.1), (7.0, 3.0, 0.0, 8.0, 3.2, 2.1))  # in "middle"
WINDOW: Box = (1.0, 7.0, 0.9, 2.5, 7.2, 2.1)
PANE: Box = (1.0, 7.08, 0.9, 2.5, 7.12, 2.1)
CUPBOARD: Box = (8.5, 5.0, 0.0, 9.5, 6.0, 1.2)
FLOOR: Box = (-0.2, -0.2, -0.2, 10.2, 7.2, 0.0)
CEILING: Box = (-0.2, -0.2, HEIGHT, 10.2, 7.2, HEIGHT + 0.2)
PIT: Box = (5.1, 4.8, -0.2, 7.0, 7.0, 0.0)  # in the store, where the floor may be left out
CELLAR_FLOOR: Box = (-0.2, -0.2, -2.7, 10.2, 7.2, -2.5)  # seen through the pit


@dataclass(frozen=True)
class SmallBuilding:
    """`T_bim_building` (4, 4); `rooms`: GlobalIds to names; `solids` in the building's frame, doors open."""

    path: Path
    T_bim_building: NDArray[np.float64]
    rooms: dict[str, str]
    solids: tuple[Box, ...]

    def from_bim(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, 3) points from the BIM frame to the building's."""
        return (points - self.T_bim_building[:3, 3]) @ self.T_bim_building[:3, :3]

    def to_bim(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, 3) points from the building's frame to the BIM frame."""
        return points @ self.T_bim_building[:3, :3].T + self.T_bim_building[:3, 3]


def write_small_ifc(
    path: Path,
    *,
    site: tuple[float, float, float] = (0.0, 0.0, 0.0),
    yaw: float = 0.0,
    elevation: float = 0.0,
    millimetres: bool = False,
    spaces: bool = True,
    slabs: bool = True,
    pit: bool = False,
) -> SmallBuilding:
    """Writes the building; `site` and `yaw` place it in the BIM frame, `elevation` is its storey's."""
    T = placed(site[0], site[1], site[2] + elevation, yaw)
    writer = IfcWriter.begun("small", {STOREY: 0.0}, T, millimetres)

    def element(ifc_class: str, name: str, solid: Box) -> Any:
        return writer.element(ifc_class, name, STOREY, [box(*solid)])

    walls = {name: element("IfcWall", name, solid) for name, solid in WALLS.items()}
    for door in DOORS:
        leaf = (door[0], 3.08, 0.0, door[3], 3.12, 2.1)
        writer.cut(walls["middle"], STOREY, box(*door), filling=element("IfcDoor", "door", leaf))
    writer.cut(walls["north"], STOREY, box(*WINDOW), filling=element("IfcWindow", "window", PANE))
    solids = [CUPBOARD, PANE, *_wall_pieces()]
    element("IfcFurnishingElement", "cupboard", CUPBOARD)
    if slabs:
        floors = [*_around(FLOOR, PIT), CELLAR_FLOOR] if pit else [FLOOR]
        for solid in (*floors, CEILING):
            element("IfcSlab", "slab", solid)
        solids += [*floors, CEILING]
    else:  # the spaces' lower and upper faces serve
        solids += [FLOOR, CEILING]
    rooms: dict[str, Any] = {}
    if spaces:
        for name, (x0, y0, x1, y1) in ROOMS.items():
            rooms[name] = writer.space(name, STOREY, box(x0, y0, 0.0, x1, y1, HEIGHT))
    writer.save(path)
    return SmallBuilding(path, T, {room.GlobalId: name for name, room in rooms.items()}, tuple(solids))


def _wall_pieces() -> Iterator[Box]:
    for name, wall in WALLS.items():
        holes = {"middle": DOORS, "north": (WINDOW,)}.get(name, ())
        left = wall[0]
        for hole in holes:
            yield (left, *wall[1:3], hole[0], *wall[4:])
            yield (hole[0], wall[1], hole[5], hole[3], *wall[4:])
            if hole[2] > wall[2]:
                yield (hole[0], *wall[1:3], hole[3], wall[4], hole[2])
            left = hole[3]
        yield (left, *wall[1:])


def _around(slab: Box, hole: Box) -> list[Box]:
    (x0, y0, z0, x1, y1, z1), (u0, v0, _, u1, v1, _) = slab, hole
    beside: list[Box] = [(x0, y0, z0, u0, y1, z1), (u1, y0, z0, x1, y1, z1)]
    return [*beside, (u0, y0, z0, u1, v0, z1), (u0, v1, z0, u1, y1, z1)]
