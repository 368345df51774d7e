"""The demo building's two storeys (`demo_building.yaml`): walls with doors and windows, rooms, furniture. Metres.

x points east, y north, both from the building's outer south-west corner; z from the storey's floor.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import shapely
import yaml

Xy = tuple[float, float]

SIZE: Xy = (30.0, 16.0)
CLEAR_HEIGHT = 2.9
STOREY_HEIGHT = 3.2
OUTER = 0.36  # thickness of outer walls
DOOR = 0.9  # width
STAIRWELL = (14.76, 12.4, 17.46, 15.64)  # lowest x y, highest x y of the opening in the upper floor


@dataclass(frozen=True)
class Opening:
    """A door or window; `middle` is its x in a wall that runs east or west, its y in any other."""

    middle: float
    width: float


@dataclass(frozen=True)
class PlanWall:
    """A wall along its middle line; where it meets an earlier wall, it ends at that one's face.

    Outer walls run with the building to their left.
    """

    start: Xy
    end: Xy
    thickness: float
    doors: tuple[Opening, ...] = ()
    windows: tuple[Opening, ...] = ()

    def along(self, opening: Opening) -> float:
        """Metres along the wall to where the opening begins."""
        begin = self.start[0] if self.start[1] == self.end[1] else self.start[1]
        return abs(opening.middle - begin) - opening.width / 2

    def rectangle(self) -> shapely.Polygon:
        """Its footprint before it is cut to length."""
        line = shapely.LineString([self.start, self.end])
        return line.buffer(self.thickness / 2, cap_style="flat")


@dataclass(frozen=True)
class Furniture:
    """A piece with the middle of its footprint at x y, facing north rotated left by `yaw` degrees."""

    kind: str  # desk, table, cupboard, chair or sofa
    x: float
    y: float
    yaw: float
    width: float  # m; 0: the kind's own


@dataclass(frozen=True)
class StoreyPlan:
    """A storey; `rooms` are given by a point in each."""

    name: str
    elevation: float
    walls: tuple[PlanWall, ...]
    rooms: dict[str, Xy]
    furniture: tuple[Furniture, ...]

    def wall_areas(self) -> list[shapely.Polygon]:
        """The walls' footprints, which touch and do not overlap, in their order."""
        areas: list[shapely.Polygon] = []
        for wall in self.walls:
            areas.append(tidied(wall.rectangle().difference(shapely.union_all(areas))))
        return areas

    def room_areas(self) -> dict[str, shapely.Polygon]:
        """What the walls enclose around each room's point."""
        free = shapely.box(0, 0, *SIZE).difference(shapely.union_all(self.wall_areas()))
        parts = shapely.get_parts(free)
        return {name: tidied(parts[shapely.intersects_xy(parts, *at)][0]) for name, at in self.rooms.items()}


def tidied(area: shapely.Polygon) -> shapely.Polygon:
    """Returns the polygon in whole millimetres, without redundant corners, starting at a well-defined corner."""
    return shapely.normalize(shapely.set_precision(area, 0.001).simplify(0.0005))


def _storey(drawn: dict[str, Any]) -> StoreyPlan:
    """A storey of the file."""
    windows = {side: tuple(Opening(*own) for own in some) for side, some in drawn["outer"].items()}
    (x, y), half = SIZE, OUTER / 2
    walls = (
        PlanWall((0.0, half), (x, half), OUTER, (), windows["south"]),
        PlanWall((x, y - half), (0.0, y - half), OUTER, (), windows["north"]),
        PlanWall((x - half, 0.0), (x - half, y), OUTER, (), windows["east"]),
        PlanWall((half, y), (half, 0.0), OUTER, windows.get("entrance", ()), windows["west"]),
        *(
            PlanWall((x0, y0), (x1, y1), thickness, tuple(Opening(middle, DOOR) for middle in doors))
            for x0, y0, x1, y1, thickness, doors in drawn["walls"]
        ),
    )
    rooms = {name: (u, v) for name, (u, v) in drawn["rooms"].items()}
    return StoreyPlan(drawn["name"], drawn["elevation"], walls, rooms, tuple(Furniture(*f) for f in drawn["furniture"]))


GROUND, UPPER = map(_storey, yaml.safe_load(Path(__file__).with_name("demo_building.yaml").read_text()))
