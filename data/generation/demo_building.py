"""The demo's building: two storeys of our own design (`demo_building.yaml`), written as an IFC4 file.

    python -m data.generation.demo_building --out FILE.ifc

It has what a real model has and a robot meets: windows over parapets, doors, a stair, and furniture of which
the A-graph knows nothing; tall cupboards stand at walls and look like walls. Metres; x points east, y north, both from
the building's outer south-west corner; z from the storey's floor.
"""

from dataclasses import dataclass
from math import atan2, hypot, radians
from pathlib import Path
from typing import Any

import numpy as np
import shapely
import yaml

from data.common.cli import Parser, run_command
from data.common.errors import UserError
from data.ifc.writer import IfcWriter, Prism, box, placed

Xy = tuple[float, float]

SIZE: Xy = (30.0, 16.0)
CLEAR_HEIGHT = 2.9
STOREY_HEIGHT = 3.2
OUTER = 0.36  # thickness of outer walls
DOOR = 0.9  # width
STAIRWELL = (14.76, 12.4, 17.46, 15.64)  # lowest x y, highest x y of the opening in the upper floor
SLAB = 0.3  # m
DOOR_HEIGHT = 2.1
LEAF = 0.04  # m thick
SILL, LINTEL = 0.9, 2.2  # m: a window's lower and upper edge
REVEAL, PANE = 0.12, 0.06  # m: the pane stands so far behind the wall's inner face, and is so thick
RISERS = 9  # of each of the stair's two flights
GOING, LANDING, FLIGHT = 0.255, 1.2, 1.25  # m: depth of a step and of the landing, width of a flight


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


DEMO_STOREY = GROUND.name  # the one to drive, where it is to be one
DEMO_STOREYS = (GROUND.name, UPPER.name)  # in the order of the demo's drive, by the stair


def write_demo_building(path: Path | str) -> None:
    """Writes the IFC model of the demo's building; raises UserError if `path` cannot be written."""
    path = Path(path)
    if path.suffix.lower() != ".ifc":
        raise UserError(f"{path}: not the name of an IFC file; give one that ends in .ifc")
    if not path.parent.is_dir():
        raise UserError(f"{path}: no such folder; create it first")
    drawn_demo_building().save(path)


def drawn_demo_building() -> IfcWriter:
    """The demo's building, to be saved."""
    writer = IfcWriter("Demo building", {s.name: s.elevation for s in (GROUND, UPPER)})
    _slabs(writer)
    _stair(writer)
    for storey in (GROUND, UPPER):
        for number, (wall, area) in enumerate(zip(storey.walls, storey.wall_areas(), strict=True), 1):
            write_wall(writer, storey.name, f"Wall {number}", wall, area, CLEAR_HEIGHT)
        for number, (name, area) in enumerate(storey.room_areas().items(), 1):
            prism = Prism(_outline(area), 0.0, CLEAR_HEIGHT)
            writer.space(f"{storey.name[0]}{number:02d}", storey.name, prism, name)
        for piece in storey.furniture:
            T_storey_piece = placed(piece.x, piece.y, yaw=radians(piece.yaw))
            writer.element("IfcFurniture", piece.kind, storey.name, _furniture(piece), T_storey_piece)
    return writer


def _outline(area: shapely.Polygon) -> tuple[tuple[float, float], ...]:
    return tuple((float(x), float(y)) for x, y in area.exterior.coords[:-1])


def _slabs(writer: IfcWriter) -> None:
    under = box(0.0, 0.0, -SLAB, *SIZE, 0.0)
    writer.element("IfcSlab", "Ground slab", GROUND.name, [under], kind="BASESLAB")
    floor = writer.element("IfcSlab", "Upper floor slab", UPPER.name, [under], kind="FLOOR")
    writer.cut(floor, UPPER.name, box(*STAIRWELL[:2], -SLAB, *STAIRWELL[2:], 0.0))
    roof = box(0.0, 0.0, CLEAR_HEIGHT, *SIZE, CLEAR_HEIGHT + SLAB)
    writer.element("IfcSlab", "Roof", UPPER.name, [roof], kind="ROOF")


def _stair(writer: IfcWriter) -> None:
    """Two flights beside each other with a landing between them; the first goes up northward in the west."""
    x0, y0, x1, y1 = STAIRWELL
    rise, middle = STOREY_HEIGHT / 2 / RISERS, STOREY_HEIGHT / 2
    body = [box(x0, y1 - LANDING, middle - SLAB, x1, y1, middle)]
    for k in range(RISERS - 1):
        north, south, top = y0 + k * GOING, y1 - LANDING - k * GOING, (k + 1) * rise
        body.append(box(x0, north, max(0.0, top - 2 * rise), x0 + FLIGHT, north + GOING, top))
        body.append(box(x1 - FLIGHT, south - GOING, middle + top - 2 * rise, x1, south, middle + top))
    writer.element("IfcStair", "Stair", GROUND.name, body, kind="HALF_TURN_STAIR")


def write_wall(writer: IfcWriter, storey: str, name: str, wall: PlanWall, area: shapely.Polygon, height: float) -> None:
    """Writes a wall with this footprint and its doors and windows. Its frame: x along it from its start, y to its
    left."""
    (x0, y0), (x1, y1) = wall.start, wall.end
    T_storey_wall = placed(x0, y0, yaw=atan2(y1 - y0, x1 - x0))
    along = np.array([x1 - x0, y1 - y0]) / hypot(x1 - x0, y1 - y0)
    relative = np.array(_outline(area)) - wall.start
    outline = np.column_stack([relative @ along, relative @ [-along[1], along[0]]]).round(4).tolist()
    prism = Prism(tuple((u, v) for u, v in outline), 0.0, height)
    host = writer.element("IfcWall", name, storey, [prism], T_storey_wall, "SOLIDWALL")
    half = wall.thickness / 2
    for ifc_class, openings, (z0, z1), (y0, y1) in (
        ("IfcDoor", wall.doors, (0.0, DOOR_HEIGHT), (-LEAF / 2, LEAF / 2)),
        ("IfcWindow", wall.windows, (SILL, LINTEL), (half - REVEAL - PANE, half - REVEAL)),
    ):
        for opening in openings:
            T_storey_hole = T_storey_wall @ placed(wall.along(opening), 0.0)
            body = [box(0.0, y0, z0, opening.width, y1, z1)]
            kind = ifc_class.removeprefix("Ifc")
            label = f"{kind} in {name}"
            filling = writer.element(ifc_class, label, storey, body, T_storey_hole, kind.upper())
            filling.OverallWidth, filling.OverallHeight = opening.width, z1 - z0
            hole = box(0.0, -half, z0, opening.width, half, z1)
            writer.cut(host, storey, hole, T_storey_hole, filling)


def _furniture(piece: Furniture) -> list[Prism]:
    """Its body in its own frame: origin in the middle of its footprint on the floor, y to where it looks."""
    if piece.kind == "cupboard":
        return [box(-piece.width / 2, -0.225, 0.0, piece.width / 2, 0.225, 1.9)]
    if piece.kind == "chair":
        seat, back = box(-0.24, -0.24, 0.42, 0.24, 0.24, 0.47), box(-0.24, -0.24, 0.47, 0.24, -0.2, 0.88)
        return [seat, back, *_legs(0.48, 0.48, 0.42, 0.04)]
    if piece.kind == "sofa":
        return [box(-0.9, -0.45, 0.05, 0.9, 0.45, 0.42), box(-0.9, -0.45, 0.42, 0.9, -0.25, 0.8)]
    width, depth = piece.width or 1.6, {"desk": 0.8, "table": 1.0}[piece.kind]
    top = box(-width / 2, -depth / 2, 0.71, width / 2, depth / 2, 0.75)
    return [top, *_legs(width, depth, 0.71, 0.06)]


def _legs(width: float, depth: float, height: float, size: float) -> list[Prism]:
    x, y = width / 2 - size, depth / 2 - size
    return [box(u, v, 0.0, u + size, v + size, height) for u in (-width / 2, x) for v in (-depth / 2, y)]


def main(arguments: list[str] | None = None) -> int:
    """The command line; raises UserError."""
    about = "Write the demo's building as an IFC4 file."
    parser = Parser(prog="python -m data.generation.demo_building", description=about)
    parser.add_argument("--out", required=True, type=Path, metavar="FILE", help="file to write (.ifc)")
    path = parser.parse_args(arguments).out
    write_demo_building(path)
    print(f"{path}: two storeys; '{DEMO_STOREY}' is the one to drive")
    return 0


if __name__ == "__main__":
    run_command(main)
