"""One storey of an IFC model or a mesh for the simulation: solid parts, rooms and floor level; doors are open."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import ifcopenshell
import numpy as np
import shapely
from ifcopenshell.util.element import get_aggregate
from numpy.typing import NDArray

from data.common.errors import UserError
from data.geometry.areas import Area, triangles_of
from data.geometry.raycast import TriangleScene, area_normals
from data.ifc.graph import read_ifc
from data.ifc.products import IfcProduct, open_ifc, products
from data.ifc.rooms import STAIRS
from data.plans.mesh_plan import is_mesh, read_mesh
from data.scene_graph import Room
from data.simulation.as_built import as_built, recut
from data.simulation.changes import AS_PLANNED, Change, Changes, draw_changes, draw_tolerances, of_class

Triangles = NDArray[np.float64]  # (M, 3, 3) metres in the BIM frame
Xy = NDArray[np.float64]  # (2,)
NOT_SOLID = ("IfcFeatureElement", "IfcDoor", "IfcVirtualElement", "IfcGeographicElement")
UPRIGHT = 0.1  # vertical part of a wall's normal, at most
SAME_NORMAL, SAME_PLANE = 0.02, 0.02  # of a normal's parts, and m: triangles as near lie in one plane
FLOOR_SEARCH = 0.6  # m: a floor or ceiling lies this close to the lower or upper face of its space


@dataclass(frozen=True)
class Space:
    """A room: its lower and upper faces, in the BIM frame; the id is an IfcSpace's GlobalId."""

    id: str
    name: str
    bottom: Triangles
    top: Triangles


@dataclass(frozen=True, eq=False)
class StoreyModel:
    """A storey in the BIM frame, in metres; `solid` and `stairs` are those of the whole building.

    `level` is the z of the finished floor, `extent` the lowest and highest (x, y), (2,) each. `changes` are the
    differences from the plan, `stands_off` how far each wall is off its place besides. The spaces are as planned, and
    `walls`, the storey's IfcWalls, are at their planned places, with their openings as built. `glazed` (M,) are the
    solid triangles of windows and of curtain walls' panels.
    """

    name: str
    level: float
    spaces: tuple[Space, ...]
    solid: Triangles
    glazed: NDArray[np.bool_]
    doors: tuple[Triangles, ...]
    extent: tuple[Xy, Xy]
    changes: tuple[Change, ...] = ()
    walls: tuple[IfcProduct, ...] = ()
    stairs: tuple[Triangles, ...] = ()
    stands_off: tuple[Change, ...] = ()


def load_storeys(
    path: Path | str, storeys: Sequence[str], changes: Changes = AS_PLANNED, seed: int = 0, tolerance: float = 0.0
) -> list[StoreyModel]:
    """Reads storeys of an IFC model by name, long name or GlobalId, or one level of a mesh (see `_mesh_storey`). One
    that is named twice is read once.

    `changes` are made to the walls, doors, windows and columns of a single storey, by `seed`; each wall stands off its
    place by a `tolerance` (m, standard deviation) besides, which is no change. Spaces that have hardly a floor or
    ceiling in the model lend their lower and upper faces as such. Raises UserError for an unreadable file, an unknown
    storey, one with nothing on it, and for changes to several storeys or to a mesh.
    """
    if is_mesh(path):
        if len(storeys) > 1 or changes.any:
            lacks = "single walls, openings or columns to change" if changes.any else "marked stairs"
            raise UserError(f"{path}: a mesh has no {lacks}; give an IFC file, or one storey as it is")
        return [_mesh_storey(path, storeys[0], seed, tolerance)]
    if len(storeys) > 1 and changes.any:
        raise UserError("changes to the building need a drive on one storey; give one storey")
    model = open_ifc(path)
    entities = [_find_storey(model, name, path) for name in storeys]
    classes = {e.is_a() for e in model.by_type("IfcElement") if not _is_any(e, NOT_SOLID)}
    solid = [p for p in products(model, tuple(sorted(classes))) if not _is_any(model.by_guid(p.global_id), NOT_SOLID)]
    others = {name: list(products(model, (name,))) for name in ("IfcSpace", "IfcDoor", "IfcOpeningElement")}

    @cache
    def read(storey: ifcopenshell.entity_instance) -> StoreyModel:
        rooms = (_space(p) for p in others["IfcSpace"] if p.storey == storey.GlobalId)
        spaces = tuple(space for space in rooms if len(space.bottom)) or _rooms_between_walls(path, storey.GlobalId)
        if not spaces:
            raise UserError(f"storey '{storey.Name or storey.GlobalId}' has no rooms to drive in; choose another one")
        return _storey_model(model, storey, spaces, solid, others, changes, seed, tolerance)

    return [read(storey) for storey in entities]


def _storey_model(
    model: ifcopenshell.file, storey: ifcopenshell.entity_instance, spaces: tuple[Space, ...],
    planned: list[IfcProduct], others: Mapping[str, list[IfcProduct]], changes: Changes, seed: int, tolerance: float,
) -> StoreyModel:  # fmt: skip
    """Of the whole building's `planned` solid products, and others by class."""

    def here(building: Iterable[IfcProduct]) -> list[IfcProduct]:
        return [p for p in building if p.storey == storey.GlobalId]

    openings = others["IfcOpeningElement"]
    made = draw_changes(model, here(planned), openings, changes, seed) if changes.any else ()
    shifts = draw_tolerances(of_class(model, here(planned), "IfcWall"), tolerance, seed) if tolerance else ()
    cut = recut(model, planned, openings, made)
    solid = as_built(model, cut, (*made, *shifts))
    triangles = np.concatenate([p.triangles for p in solid])
    panes = np.concatenate([np.full(len(p.faces), _is_pane(model.by_guid(p.global_id))) for p in solid])
    stairs = [p.triangles for p in solid if p.ifc_class in STAIRS]
    level = _floor_of_spaces(spaces)
    floors, ceilings = (_missing_faces(triangles, spaces, stairs, sign) for sign in (-1.0, 1.0))
    if floors:  # in doorways too, under the openings that stand on the floor
        holes = (p.triangles for p in as_built(model, openings, made))
        floors += [hole[np.abs(hole[:, :, 2] - level).max(axis=1) < 0.05] for hole in holes]
    triangles = np.concatenate([triangles, *floors, *ceilings])
    extent = _extent(spaces)
    level = _measured_floor(TriangleScene(triangles), level, extent)
    glazed = np.pad(panes, (0, len(triangles) - len(panes)))
    leaves = tuple(p.triangles for p in here(as_built(model, others["IfcDoor"], (*made, *shifts))))
    walls = tuple(of_class(model, here(cut), "IfcWall"))
    return StoreyModel(
        storey.Name or "", level, spaces, triangles, glazed, leaves, extent, made, walls,
        tuple(stairs), shifts,
    )  # fmt: skip


def _rooms_between_walls(path: Path | str, storey: str) -> tuple[Space, ...]:
    """The rooms of a storey (GlobalId) without spaces, as its A-graph has them."""
    graph, _ = read_ifc(path)
    z = next((floor.elevation for floor in graph.floors if floor.id == storey), None) or 0.0
    rooms = [room for room in graph.rooms if room.floor == storey and room.polygon is not None]
    return tuple(_flat_space(room, shapely.Polygon(room.polygon), z) for room in rooms)


def _flat_space(room: Room, area: Area, *levels: float) -> Space:
    """With a level lower face, and an upper one if its height is known too."""
    plan = triangles_of(area)
    low, *high = (np.dstack([plan, np.full(plan.shape[:2], z)]) for z in levels)
    return Space(room.id, room.name, low, high[0] if high else low[:0])


def _extent(spaces: Iterable[Space]) -> tuple[Xy, Xy]:
    corners = np.concatenate([space.bottom for space in spaces]).reshape(-1, 3)[:, :2]
    return corners.min(axis=0), corners.max(axis=0)


def _find_storey(model: ifcopenshell.file, storey: str, ifc: Path | str) -> ifcopenshell.entity_instance:
    storeys = model.by_type("IfcBuildingStorey")
    for key in (str, str.casefold):
        for s in storeys:
            if key(storey) in {key(n) for n in (s.GlobalId, s.Name, s.LongName) if n}:
                return s
    names = ", ".join(f"'{s.Name or s.GlobalId}'" for s in storeys) or "none"
    missing = f"no storey '{storey}'" if storey else "no storey was named (--storey)"
    raise UserError(f"{ifc}: {missing}; it has: {names}")


def _is_any(entity: ifcopenshell.entity_instance, classes: tuple[str, ...]) -> bool:
    return any(entity.is_a(c) for c in classes)


def _is_pane(entity: ifcopenshell.entity_instance) -> bool:
    """Windows with their frames; a curtain wall's panels, but not its posts."""
    whole = get_aggregate(entity)
    of_curtain = entity.is_a("IfcPlate") and whole is not None and whole.is_a("IfcCurtainWall")
    return bool(of_curtain) or _is_any(entity, ("IfcWindow", "IfcCurtainWall"))


def _space(product: IfcProduct) -> Space:
    triangles = product.triangles
    normals = area_normals(triangles)
    level = np.abs(normals[:, 2]) > 0.5 * np.linalg.norm(normals, axis=1)
    middle = (product.vertices[:, 2].min() + product.vertices[:, 2].max()) / 2
    low = triangles[:, :, 2].mean(axis=1) < middle
    return Space(product.global_id, product.name, triangles[level & low], triangles[level & ~low])


def _floor_of_spaces(spaces: tuple[Space, ...]) -> float:
    """The median of the lower faces' z, weighted by area: some spaces lie deeper (shafts) or higher."""
    faces = np.concatenate([s.bottom for s in spaces])
    z, area = faces[:, :, 2].mean(axis=1), np.abs(area_normals(faces)[:, 2])
    order = np.argsort(z)
    total = np.cumsum(area[order])
    return float(z[order][np.searchsorted(total, total[-1] / 2)])


def _measured_floor(scene: TriangleScene, level: float, extent: tuple[Xy, Xy]) -> float:
    """The z that most rays down from FLOOR_SEARCH above the level hit; the level if hardly any hit."""
    xy = np.random.default_rng(0).uniform(*extent, (5000, 2))
    origins = np.column_stack([xy, np.full(len(xy), level + FLOOR_SEARCH)])
    z = level + FLOOR_SEARCH - scene.distances(origins, np.array([0.0, 0.0, -1.0]))
    z = z[np.abs(z - level) < FLOOR_SEARCH - 0.01]  # origins inside of things see these things' lower faces
    if len(z) < 0.1 * len(xy):
        return level
    counts, edges = np.histogram(z, np.arange(z.min(), z.max() + 0.04, 0.02))
    most = edges[np.argmax(counts)] + 0.01
    return round(float(np.median(z[np.abs(z - most) <= 0.02])), 4)  # rays count in float32


def _missing_faces(
    solid: Triangles, spaces: tuple[Space, ...], stairs: list[Triangles], sign: float
) -> list[Triangles]:
    """Lower (sign -1) or upper (+1) faces of the spaces that have hardly a floor or ceiling in the model.

    Where a stair leads through the face, it is left open.
    """
    scene = TriangleScene(solid)
    faces = [s.bottom if sign < 0 else s.top for s in spaces]
    return [f for f in faces if len(f) and _covered(scene, f, sign) < 0.5 and not _stair_crosses(f, stairs)]


def _covered(scene: TriangleScene, faces: Triangles, sign: float) -> float:
    """The share of points on the faces that have a surface within FLOOR_SEARCH behind them."""
    area = np.abs(area_normals(faces)[:, 2])
    rng = np.random.default_rng(0)
    chosen = faces[rng.choice(len(faces), 200, p=area / area.sum())]
    weights = rng.dirichlet(np.ones(3), 200)
    points = np.einsum("nk,nkd->nd", weights, chosen) - [0, 0, sign * 0.3]
    return float(np.mean(scene.distances(points, np.array([0.0, 0.0, sign])) < 0.3 + FLOOR_SEARCH))


def _stair_crosses(faces: Triangles, stairs: list[Triangles]) -> bool:
    corners = faces.reshape(-1, 3)
    low, high = corners.min(axis=0) + 0.1, corners.max(axis=0) - 0.1
    low[2], high[2] = (corners[:, 2].mean() + beyond for beyond in (-0.3, -0.5))
    boxes = ((stair.min(axis=(0, 1)), stair.max(axis=(0, 1))) for stair in stairs)
    return any((least <= high).all() and (most >= low).all() for least, most in boxes)


def _mesh_storey(path: Path | str, storey: str, seed: int, tolerance: float) -> StoreyModel:
    """Reads the mesh; `storey` is the id or name of a level in its A-graph, empty for the lowest. With a `tolerance`
    (m, standard deviation), each upright plane of the mesh stands off its place.

    Raises UserError for an unknown level, or one without rooms.
    """
    building = read_mesh(path)
    names = {f.id: f.name for f in building.graph.floors}
    levels = [v for v in building.levels if v.floor is not None and storey in ("", v.floor, names[v.floor])]
    if not levels:
        raise UserError(f"{path}: no level '{storey}'; it has: {', '.join(repr(name) for name in names.values())}")
    level = levels[0]
    spaces = tuple(_flat_space(of.room, of.area, level.bottom, level.top) for of in level.rooms)
    solid = _shifted(building.triangles, tolerance, seed) if tolerance else building.triangles
    name, no_panes = names[str(level.floor)], np.zeros(len(solid), dtype=bool)
    return StoreyModel(name, level.bottom, spaces, solid, no_panes, (), _extent(spaces))


def _shifted(triangles: Triangles, tolerance: float, seed: int) -> Triangles:
    """Each upright plane moved along its normal, at random."""
    normals = 2 * area_normals(triangles)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    upright = np.abs(normals[:, 2]) < UPRIGHT
    offsets = np.einsum("ij,ij->i", normals, triangles.mean(axis=1))
    keys = np.round(np.column_stack([normals[:, :2] / SAME_NORMAL, offsets / SAME_PLANE])).astype(int)
    _, plane = np.unique(keys, axis=0, return_inverse=True)
    shift = np.random.default_rng([seed, 102]).normal(0.0, tolerance, int(plane.max()) + 1)[plane.ravel()]
    flat = normals * [1.0, 1.0, 0.0]
    return triangles + (np.where(upright, shift, 0.0)[:, None] * flat)[:, None]
