"""The demo building's two storeys: walls with doors and windows, rooms, furniture. Metres.

x points east, y north, both from the building's outer south-west corner; z from the storey's floor.
"""

from dataclasses import dataclass

import shapely

Xy = tuple[float, float]
Pairs = tuple[tuple[float, float], ...]

SIZE: Xy = (30.0, 16.0)
CLEAR_HEIGHT = 2.9
STOREY_HEIGHT = 3.2
OUTER, MAIN, THIN = 0.36, 0.2, 0.12  # thickness of walls
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
    thickness: float = THIN
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
    yaw: float = 0.0
    width: float = 0.0  # m; 0: the kind's own


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


def _doors(*middles: float) -> tuple[Opening, ...]:
    return tuple(Opening(middle, DOOR) for middle in middles)


def _outer(south: Pairs, east: Pairs, north: Pairs, west: Pairs, entrance: Pairs = ()) -> tuple[PlanWall, ...]:
    """The four outer walls with their windows, each given by its middle and width, and a door in the west."""
    (x, y), half = SIZE, OUTER / 2
    return (
        PlanWall((0.0, half), (x, half), OUTER, (), _openings(south)),
        PlanWall((x, y - half), (0.0, y - half), OUTER, (), _openings(north)),
        PlanWall((x - half, 0.0), (x - half, y), OUTER, (), _openings(east)),
        PlanWall((half, y), (half, 0.0), OUTER, _openings(entrance), _openings(west)),
    )


def _openings(pairs: Pairs) -> tuple[Opening, ...]:
    return tuple(Opening(middle, width) for middle, width in pairs)


_f = Furniture  # short, for the rows below

# Ground floor: the corridor runs from the hall in the west to the east wall, between two rows of rooms.
GROUND = StoreyPlan(
    "Ground floor",
    0.0,
    (
        *_outer(
            south=((2.2, 1.2), (9.4, 1.8), (12.4, 1.8), (16.2, 2.0), (19.0, 2.0), (23.1, 1.6), (27.4, 1.4)),
            east=((5.8, 1.2), (9.1, 1.0), (12.8, 2.0)),
            north=((2.6, 2.0), (5.4, 2.0), (9.25, 1.6), (12.83, 1.6), (19.5, 2.0), (22.2, 2.0), (26.4, 2.0)),
            west=((5.1, 1.4), (8.8, 1.0), (12.9, 2.4)),
            entrance=((7.0, 1.2),),
        ),
        PlanWall((0.18, 10.1), (29.82, 10.1), MAIN, _doors(5.6, 8.2, 11.78, 15.4, 18.6, 27.8)),
        PlanWall((7.46, 0.18), (7.46, 10.1), THIN, _doors(9.1)),
        PlanWall((7.46, 8.1), (29.82, 8.1), MAIN, _doors(8.8, 12.9, 17.4, 22.0, 26.9)),
        PlanWall((0.18, 3.95), (7.46, 3.95), THIN, _doors(3.2, 5.4)),
        PlanWall((4.45, 0.18), (4.45, 3.95)),
        PlanWall((7.46, 10.1), (7.46, 15.82)),
        PlanWall((11.04, 10.1), (11.04, 15.82)),
        PlanWall((14.66, 10.1), (14.66, 15.82), MAIN),
        PlanWall((17.56, 10.1), (17.56, 15.82), MAIN),
        PlanWall((24.06, 10.1), (24.06, 15.82)),
        PlanWall((14.46, 0.18), (14.46, 8.1), THIN, _doors(2.5)),
        PlanWall((11.2, 5.3), (14.46, 5.3)),
        PlanWall((11.2, 5.3 - THIN / 2), (11.2, 8.1)),
        PlanWall((21.06, 0.18), (21.06, 8.1)),
        PlanWall((25.06, 0.18), (25.06, 8.1)),
        PlanWall((25.06, 3.5), (29.82, 3.5), THIN, _doors(26.4)),
    ),
    {
        "Hall": (3.0, 8.0), "Corridor": (20.0, 9.0), "Cloakroom": (2.0, 2.0), "Washroom": (6.0, 2.0),
        "Meeting room": (3.0, 12.0), "Office 1": (9.0, 12.0), "Office 2": (13.0, 12.0),
        "Stairs": (16.0, 11.0), "Laboratory": (20.0, 12.0), "Kitchen": (27.0, 12.0),
        "Open-plan office": (9.0, 3.0), "Store": (13.0, 7.0), "Workshop": (18.0, 3.0),
        "Library": (23.0, 3.0), "Archive": (27.0, 6.0), "Plant room": (27.0, 2.0),
    },
    (
        # Hall, cloakroom, washroom, meeting room
        _f("table", 5.5, 6.7, 90, 2.4), _f("chair", 6.4, 6.7, 90),
        _f("sofa", 2.0, 9.5, 180), _f("sofa", 0.86, 5.1, -90),
        _f("cupboard", 7.165, 5.2, 90, 1.8),
        _f("cupboard", 0.595, 2.1, -90, 2.4), _f("cupboard", 3.6, 0.595, 0, 1.2),
        _f("cupboard", 6.6, 0.595, 0, 1.2),
        _f("table", 3.4, 13.0, 0, 3.2),
        *(_f("chair", x, 12.1, 0) for x in (2.4, 3.4, 4.4)),
        *(_f("chair", x, 13.9, 180) for x in (2.4, 3.4, 4.4)),
        _f("cupboard", 7.165, 13.6, 90, 2.4),
        # The two equal offices, laboratory, kitchen
        _f("desk", 8.7, 15.1, 180), _f("chair", 8.7, 14.4),
        _f("cupboard", 10.745, 12.4, 90, 1.8), _f("chair", 9.9, 10.7),
        _f("desk", 13.4, 15.1, 180), _f("chair", 13.4, 14.4),
        _f("cupboard", 11.335, 13.6, -90, 1.8), _f("sofa", 14.05, 11.8, 90),
        _f("table", 20.8, 13.0, 0, 3.0), _f("chair", 20.2, 12.1), _f("chair", 21.6, 12.1),
        _f("cupboard", 23.765, 12.0, 90, 2.4), _f("desk", 22.4, 15.1, 180),
        _f("chair", 22.4, 14.4), _f("cupboard", 17.895, 13.6, -90, 1.8),
        _f("table", 26.7, 13.4, 90, 1.8), _f("chair", 25.8, 13.4, -90),
        _f("chair", 27.6, 13.4, 90), _f("cupboard", 24.355, 13.0, -90, 2.4),
        _f("sofa", 29.15, 14.4, 90),
        # Open-plan office, store, workshop
        _f("desk", 9.4, 0.95), _f("chair", 9.4, 1.65), _f("desk", 12.3, 0.95),
        _f("chair", 12.3, 1.65), _f("cupboard", 7.755, 4.6, -90, 2.4),
        _f("cupboard", 12.8, 5.005, 180, 1.8), _f("table", 10.2, 4.3, 0, 1.6),
        _f("cupboard", 11.495, 6.7, -90, 1.8), _f("cupboard", 13.4, 5.595, 0, 1.8),
        _f("table", 18.2, 4.4, 0, 2.4), _f("table", 17.6, 1.2, 0, 2.4),
        _f("chair", 18.2, 5.3, 180), _f("cupboard", 20.765, 3.2, 90, 2.4),
        _f("cupboard", 14.755, 5.8, -90, 1.8), _f("cupboard", 19.6, 7.765, 180, 1.8),
        # Library, archive, plant room
        _f("cupboard", 24.765, 2.6, 90, 2.4), _f("cupboard", 24.765, 5.6, 90, 2.4),
        _f("cupboard", 21.355, 3.6, -90, 2.4), _f("table", 23.0, 1.4, 0, 1.8),
        _f("chair", 23.0, 2.3, 180), _f("sofa", 23.3, 5.4, 90),
        _f("cupboard", 25.355, 5.8, -90, 2.4), _f("cupboard", 28.5, 3.795, 0, 1.8),
        _f("desk", 29.2, 6.9, 90), _f("chair", 28.5, 6.9, -90),
        _f("cupboard", 29.0, 0.595, 0, 1.2), _f("table", 25.7, 1.5, -90, 1.6),
    ),
)  # fmt: skip

# Upper floor: the corridor crosses the whole building further south; the stairs arrive beside the foyer.
UPPER = StoreyPlan(
    "Upper floor",
    STOREY_HEIGHT,
    (
        *_outer(
            south=((3.2, 2.4), (8.3, 1.6), (12.4, 1.6), (15.8, 0.8), (19.2, 2.0), (22.2, 2.0), (27.0, 2.4)),
            east=((3.0, 1.6), (6.9, 1.0), (9.8, 1.6), (13.7, 1.6)),
            north=((3.0, 2.4), (6.4, 2.4), (11.8, 2.0), (19.6, 2.0), (22.8, 2.0), (27.4, 1.6)),
            west=((3.0, 1.6), (6.9, 1.0), (10.4, 2.0), (13.6, 2.0)),
        ),
        PlanWall((0.18, 5.9), (29.82, 5.9), MAIN, _doors(4.9, 9.6, 11.12, 15.6, 18.2, 28.3)),
        PlanWall((0.18, 7.9), (29.82, 7.9), MAIN, _doors(7.4, 11.8, 16.1, 19.0, 23.4, 26.4)),
        PlanWall((14.66, 7.9), (14.66, 15.82), MAIN, _doors(11.2)),
        PlanWall((17.56, 7.9), (17.56, 15.82), MAIN),
        PlanWall((14.66, 10.1), (17.56, 10.1), MAIN),
        PlanWall((8.94, 7.9), (8.94, 15.82)),
        PlanWall((25.26, 7.9), (25.26, 15.82), THIN, _doors(14.2)),
        PlanWall((17.56, 11.0), (20.6, 11.0)),
        PlanWall((20.6, 7.9), (20.6, 11.0 + THIN / 2)),
        PlanWall((25.26, 11.8), (29.82, 11.8)),
        PlanWall((6.26, 0.18), (6.26, 5.9)),
        PlanWall((10.36, 0.18), (10.36, 5.9)),
        PlanWall((14.46, 0.18), (14.46, 5.9)),
        PlanWall((17.06, 0.18), (17.06, 5.9)),
        PlanWall((24.26, 0.18), (24.26, 5.9)),
    ),
    {
        "Foyer": (12.0, 12.0), "Corridor": (20.0, 7.0), "Stairs": (16.0, 11.0), "Lecture room": (4.0, 12.0),
        "Copy room": (16.0, 9.0), "Server room": (19.0, 9.0), "Studio": (23.0, 12.0), "Office 5": (27.0, 10.0),
        "Office 6": (27.0, 14.0), "Break room": (3.0, 3.0), "Office 3": (8.0, 3.0), "Office 4": (12.0, 3.0),
        "Wardrobe": (16.0, 3.0), "Seminar room": (20.0, 3.0), "Director": (27.0, 3.0),
    },
    (
        # Foyer, lecture room, copy room
        _f("sofa", 9.5, 12.4, -90), _f("sofa", 11.8, 15.1, 180), _f("table", 11.4, 12.6, 90, 1.6),
        _f("cupboard", 14.325, 13.8, 90, 1.8),
        *(_f("table", x, y, 0, 2.0) for x in (2.6, 5.8) for y in (10.2, 12.0, 13.8)),
        *(_f("chair", x, y, 180) for x in (2.6, 5.8) for y in (10.95, 12.75, 14.55)),
        _f("cupboard", 8.645, 12.6, 90, 2.4),
        _f("cupboard", 17.225, 9.1, 90, 1.2),
        # Server room, studio, offices in the north-east
        _f("cupboard", 17.895, 9.6, -90, 1.8), _f("cupboard", 19.4, 10.705, 180, 1.8),
        _f("table", 22.8, 11.6, 90, 2.4), _f("chair", 21.9, 11.6, -90),
        _f("desk", 19.4, 15.1, 180), _f("chair", 19.4, 14.4), _f("desk", 22.6, 15.1, 180),
        _f("chair", 22.6, 14.4), _f("cupboard", 17.895, 13.0, -90, 2.4),
        _f("cupboard", 24.965, 11.0, 90, 1.8),
        _f("desk", 28.8, 9.8, 90), _f("chair", 28.1, 9.8, -90),
        _f("cupboard", 27.6, 11.505, 180, 1.8), _f("desk", 28.8, 13.7, 90),
        _f("chair", 28.1, 13.7, -90), _f("cupboard", 27.0, 12.095, 0, 1.8),
        # Break room, the two equal offices, wardrobe
        _f("table", 3.0, 2.8, 0, 2.0), _f("chair", 2.5, 1.9), _f("chair", 3.5, 3.7, 180),
        _f("sofa", 0.86, 4.6, -90), _f("cupboard", 5.965, 2.0, 90, 1.8),
        _f("desk", 8.3, 0.95), _f("chair", 8.3, 1.65), _f("cupboard", 6.555, 4.0, -90, 1.8),
        _f("desk", 12.4, 0.95), _f("chair", 12.4, 1.65), _f("cupboard", 14.165, 3.0, 90, 1.8),
        _f("cupboard", 14.755, 2.2, -90, 2.4), _f("cupboard", 16.765, 3.8, 90, 1.8),
        # Seminar room, director
        _f("table", 20.8, 2.9, 0, 3.2), *(_f("chair", x, 2.0) for x in (19.8, 20.8, 21.8)),
        *(_f("chair", x, 3.8, 180) for x in (19.8, 20.8, 21.8)),
        _f("cupboard", 22.6, 5.565, 180, 2.4),
        _f("desk", 27.8, 2.0, 180, 2.0), _f("chair", 27.8, 1.3), _f("sofa", 24.9, 2.6, -90),
        _f("cupboard", 26.0, 5.565, 180, 2.4),
    ),
)  # fmt: skip
