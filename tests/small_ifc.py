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

import ifcopenshell
import ifcopenshell.api.aggregate
import ifcopenshell.api.context
import ifcopenshell.api.feature
import ifcopenshell.api.geometry
import ifcopenshell.api.project
import ifcopenshell.api.root
import ifcopenshell.api.spatial
import ifcopenshell.api.unit
import numpy as np
from ifcopenshell.util.shape_builder import ShapeBuilder
from numpy.typing import NDArray

Box = tuple[float, float, float, float, float, float]  # lowest x y z, highest x y z

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
    T = np.eye(4)
    T[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    T[:3, 3] = site[0], site[1], site[2] + elevation
    make = _Maker(T, millimetres)
    walls = {name: make.element("IfcWall", name, box) for name, box in WALLS.items()}
    for door in DOORS:
        leaf = (door[0], 3.08, 0.0, door[3], 3.12, 2.1)
        make.fill(walls["middle"], door, make.element("IfcDoor", "door", leaf))
    make.fill(walls["north"], WINDOW, make.element("IfcWindow", "window", PANE))
    solids = [CUPBOARD, PANE, *_wall_pieces()]
    make.element("IfcFurnishingElement", "cupboard", CUPBOARD)
    if slabs:
        floors = [*_around(FLOOR, PIT), CELLAR_FLOOR] if pit else [FLOOR]
        for box in (*floors, CEILING):
            make.element("IfcSlab", "slab", box)
        solids += [*floors, CEILING]
    else:  # the spaces' lower and upper faces serve
        solids += [FLOOR, CEILING]
    rooms = {make.space(name, rectangle): name for name, rectangle in ROOMS.items()} if spaces else {}
    make.model.write(str(path))
    return SmallBuilding(path, T, rooms, tuple(solids))


def _wall_pieces() -> Iterator[Box]:
    for name, box in WALLS.items():
        holes = {"middle": DOORS, "north": (WINDOW,)}.get(name, ())
        left = box[0]
        for hole in holes:
            yield (left, *box[1:3], hole[0], *box[4:])
            yield (hole[0], box[1], hole[5], hole[3], *box[4:])
            if hole[2] > box[2]:
                yield (hole[0], *box[1:3], hole[3], box[4], hole[2])
            left = hole[3]
        yield (left, *box[1:])


def _around(box: Box, hole: Box) -> list[Box]:
    (x0, y0, z0, x1, y1, z1), (u0, v0, _, u1, v1, _) = box, hole
    beside: list[Box] = [(x0, y0, z0, u0, y1, z1), (u1, y0, z0, x1, y1, z1)]
    return [*beside, (u0, y0, z0, u1, v0, z1), (u0, v1, z0, u1, y1, z1)]


class _Maker:
    """Makes products whose shapes are boxes, all placed like the storey."""

    def __init__(self, T_bim_building: NDArray[np.float64], millimetres: bool) -> None:
        self.model = ifcopenshell.api.project.create_file(version="IFC4")
        self._builder = ShapeBuilder(self.model)
        self._T, self._unit = T_bim_building, 1000.0 if millimetres else 1.0
        project = self._entity("IfcProject", "small")
        raw = "MILLIMETERS" if millimetres else "METERS"
        ifcopenshell.api.unit.assign_unit(self.model, length={"is_metric": True, "raw": raw})
        context = ifcopenshell.api.context.add_context(self.model, context_type="Model")
        self._body = ifcopenshell.api.context.add_context(
            self.model, "Model", context_identifier="Body", target_view="MODEL_VIEW", parent=context
        )
        site, building = self._entity("IfcSite", "site"), self._entity("IfcBuilding", "building")
        self.storey = self._entity("IfcBuildingStorey", "Ground")
        for part, whole in ((site, project), (building, site), (self.storey, building)):
            ifcopenshell.api.aggregate.assign_object(self.model, products=[part], relating_object=whole)
        for placed in (site, building, self.storey):
            self._place(placed)

    def _entity(self, ifc_class: str, name: str) -> ifcopenshell.entity_instance:
        return ifcopenshell.api.root.create_entity(self.model, ifc_class=ifc_class, name=name)

    def _place(self, product: ifcopenshell.entity_instance) -> None:
        ifcopenshell.api.geometry.edit_object_placement(self.model, product=product, matrix=self._T)

    def _shape(self, product: ifcopenshell.entity_instance, box: Box) -> None:
        low, high = np.array(box[:3]) * self._unit, np.array(box[3:]) * self._unit
        solid = self._builder.extrude(
            self._builder.rectangle(size=(high - low)[:2]), magnitude=float((high - low)[2]), position=low
        )
        shape = self._builder.get_representation(self._body, solid)
        ifcopenshell.api.geometry.assign_representation(self.model, product=product, representation=shape)
        self._place(product)

    def element(self, ifc_class: str, name: str, box: Box) -> ifcopenshell.entity_instance:
        product = self._entity(ifc_class, name)
        ifcopenshell.api.spatial.assign_container(self.model, [product], relating_structure=self.storey)
        self._shape(product, box)
        return product

    def fill(
        self, wall: ifcopenshell.entity_instance, hole: Box, filling: ifcopenshell.entity_instance
    ) -> None:
        opening = self._entity("IfcOpeningElement", "opening")
        self._shape(opening, hole)
        ifcopenshell.api.feature.add_feature(self.model, feature=opening, element=wall)
        ifcopenshell.api.feature.add_filling(self.model, opening=opening, element=filling)

    def space(self, name: str, rectangle: tuple[float, float, float, float]) -> str:
        product = self._entity("IfcSpace", name)
        ifcopenshell.api.aggregate.assign_object(self.model, products=[product], relating_object=self.storey)
        self._shape(product, (*rectangle[:2], 0.0, *rectangle[2:], HEIGHT))
        return str(product.GlobalId)
