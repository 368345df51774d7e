"""A building's mesh as an A-graph: its floors, the closed faces between its walls as rooms, its wall surfaces, doors.

    python -m data.plans.mesh_plan --mesh FILE [FILE ...] --out A_GRAPH.json

The mesh is of the building: walls with two sides on a floor, with or without ceilings; what stands in it counts as
wall where it is cut at 0.5 to 1.7 m above the floor.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from data.common.cli import Parser, run_command
from data.common.errors import UserError
from data.geometry.areas import Area, closed, difference, opened, united
from data.geometry.level_faces import level_faces
from data.geometry.raycast import area_normals
from data.scene_graph import Door, Floor, LevelSurface, SceneGraph, WallSurface
from data.walls.levels import PlannedLevels, level_surfaces
from data.walls.rooms import (
    GAP,
    MIN_AREA,
    PASSABLE,
    PASSAGE,
    STOREY,
    Level,
    doors_of,
    doorways,
    open_area,
    rooms_of_faces,
    width_of,
)
from data.walls.solids import MeshSolid, mesh_solid
from data.walls.surfaces import CUTS, surfaces_at

Array = NDArray[np.float64]
LINTELS = (1.95, 2.05, 2.15, 2.3, 2.45, 2.6)  # m above the floor, where doorways have an upper end
SAME_FLOOR = 0.1  # m
PART_OF_MOST = 0.3  # of the largest floor's area that another floor has at least
SLIVER = 0.01  # m: sections of one wall at two heights differ by less
MESH_SUFFIXES = (".stl", ".dae", ".obj", ".ply")
HIGHEST = 400.0  # m: what is higher is not in metres
WIDEST = 20_000.0  # m: likewise


@dataclass(frozen=True, eq=False)
class MeshBuilding:
    """The A-graph of a mesh in the mesh's own frame ("bim"), its triangles (M, 3, 3), and its rooms as volumes."""

    graph: SceneGraph
    triangles: Array
    levels: tuple[Level, ...]


def read_mesh(path: Path | str, *more: Path | str) -> MeshBuilding:
    """Reads a mesh, or the parts of one in several files (see `read_triangles`). Rooms end at walls, at doorways
    (openings under a lintel, up to 1.6 m wide) and at the floor's edge; storeys are its level floors with walls on
    them.

    Raises UserError where the file cannot be read or has no walls standing on a floor.
    """
    triangles = read_triangles(path, *more)
    solid = mesh_solid(triangles)
    levels: list[Level] = []
    doors: list[Door] = []
    surfaces: list[WallSurface] = []
    for z, floor in _floors(triangles):
        level, openings = _level(solid, z, floor, len(levels))
        if level.rooms:
            levels.append(level)
            found = enumerate(doors_of("", openings, level.rooms), len(doors) + 1)
            doors += [replace(d, id=f"door-{k}") for k, d in found]
    tops = [*(level.bottom for level in levels[1:]), solid.top]
    for level, top in zip(levels, tops, strict=False):
        surfaces += surfaces_at(replace(level, top=top), [solid])
    if not surfaces:
        raise UserError(f"{path}: no walls that stand on a floor; give the mesh of a building, walls with two sides")
    floors = tuple(Floor(str(v.floor), f"level {v.bottom:.2f}", v.bottom) for v in levels)
    volumes = [room for level in levels for room in level.rooms]
    faces = PlannedLevels(list(level_faces(triangles, is_body=False)))
    seen = level_surfaces(faces, volumes, floors, lambda area, _: area)
    ceilings = _ceilings(seen, {v.room.id: v.area for v in volumes})
    # what has no source is a wall of its own: all of a mesh is one body
    numbered = []
    for k, s in enumerate(sorted(surfaces, key=lambda s: s.room is None), 1):
        ceiling = ceilings.get(s.room or "")
        height = None if ceiling is None or s.height is None else (s.height[0], ceiling)
        numbered.append(replace(s, id=f"surface-{k}", source="", height=height))
    rooms = tuple(v.room for v in volumes)
    graph = SceneGraph("bim", rooms, tuple(numbered), tuple(doors), floors, level_surfaces=seen)
    return MeshBuilding(graph, triangles, tuple(levels))


def _floors(triangles: Array) -> list[tuple[float, Area]]:
    """The heights of level upward faces, lowest first, and their areas in plan."""
    normal = area_normals(triangles)
    size = np.linalg.norm(normal, axis=1)
    level = normal[:, 2] > 0.99 * size
    faces, area, z = triangles[level], size[level], triangles[level, :, 2].mean(axis=1)
    found: list[tuple[float, Area, float]] = []
    free = np.ones(len(z), dtype=bool)
    while free.any():
        sums = np.array([area[free & (np.abs(z - at) < SAME_FLOOR)].sum() for at in np.where(free, z, np.inf)])
        own = free & (np.abs(z - z[np.argmax(sums)]) < SAME_FLOOR)
        if found and area[own].sum() < PART_OF_MOST * found[0][2]:
            break
        bottom = float(np.average(z[own], weights=area[own]))
        if all(abs(bottom - other) >= STOREY for other, _, _ in found):
            found.append((bottom, united(shapely.polygons(faces[own][:, :, :2])), float(area[own].sum())))
        free &= ~own
    return sorted(((bottom, floor) for bottom, floor, _ in found), key=lambda f: f[0])


def _ceilings(levels: tuple[LevelSurface, ...], rooms: dict[str, Area]) -> dict[str, float]:
    """The height of the ceiling over most of each room, by the room's id, for those that have one in the mesh."""
    found = {}
    for level in levels:
        ceiling = shapely.Polygon(level.polygon, level.holes)
        if level.room is not None and not level.is_floor and ceiling.area > rooms[level.room].area / 2:
            found[level.room] = level.height(ceiling.centroid.x, ceiling.centroid.y)
    return found


def _level(solid: MeshSolid, z: float, floor: Area, number: int) -> tuple[Level, list[Area]]:
    """A storey with its rooms by position, and its doorways."""
    walls = united(solid.section(z + height) for height in CUTS)
    overhead = opened(difference(united(solid.section(z + height) for height in LINTELS), walls), SLIVER)
    lintels = doorways(overhead)
    shut = closed(united([walls, *lintels]), GAP)
    inside = united(shapely.Polygon(p.exterior) for p in shapely.get_parts(united([floor, walls])))
    parts = [p for p in shapely.get_parts(opened(difference(inside, shut), PASSAGE)) if p.area >= MIN_AREA]
    parts.sort(key=lambda p: (round(p.centroid.x, 2), round(p.centroid.y, 2)))
    if walls.is_empty:
        parts = []
    key = f"storey-{number + 1}"
    volumes = rooms_of_faces(parts, key, key, z, z + STOREY)
    passable = [d for d in lintels if width_of(d) >= PASSABLE]
    return Level(key, z, solid.top, volumes, open_area(shut, parts)), passable


def main() -> int:
    """The command line; raises UserError."""
    parser = Parser(prog="python -m data.plans.mesh_plan", description="Derive an A-graph from the mesh of a building.")
    about = "mesh: .stl, .dae, .obj or .ply, in metres, z up; several files are parts of one building"
    parser.add_argument("--mesh", required=True, nargs="+", type=Path, metavar="FILE", help=about)
    parser.add_argument("--out", required=True, type=Path, metavar="FILE", help="file for the A-graph (.json)")
    options = parser.parse_args()
    graph = read_mesh(*options.mesh).graph
    graph.save(options.out)
    counts = f"{len(graph.floors)} storeys, {len(graph.rooms)} rooms, {len(graph.wall_surfaces)} wall surfaces"
    print(f"{options.out}: {counts}")
    return 0


if __name__ == "__main__":
    run_command(main)


def is_mesh(path: Path | str) -> bool:
    """Whether a file's suffix is that of a mesh."""
    return Path(path).suffix.lower() in MESH_SUFFIXES


def read_triangles(path: Path | str, *more: Path | str) -> NDArray[np.float64]:
    """Returns (M, 3, 3) the triangles of one or more `.stl`, `.dae`, `.obj` or `.ply` files, in metres with z up.

    COLLADA's unit and up axis are used; the other formats do not state theirs and are taken as metres with z up. Raises
    UserError for a file that is missing, of another kind, unreadable or empty, and if all together are implausibly
    large.
    """
    triangles = np.concatenate([_triangles(Path(p)) for p in (path, *more)])
    with np.errstate(over="ignore"):
        *width, height = np.ptp(triangles.reshape(-1, 3), axis=0).tolist()
    if not 1.0 < height < HIGHEST or not max(width) < WIDEST:
        size = f"{height:g} m high and up to {max(width):g} m wide"
        raise UserError(f"{path}: is {size}; give a building in metres with z up")
    return triangles


def _triangles(path: Path) -> NDArray[np.float64]:
    import trimesh

    if not path.is_file() or not is_mesh(path):
        raise UserError(f"{path}: not a mesh; give a file that ends in {', '.join(MESH_SUFFIXES)}")
    try:
        scene = trimesh.load_scene(path)
        triangles = np.asarray(scene.to_mesh().triangles, dtype=float)
    except Exception as error:  # trimesh's readers raise kinds of their own
        missing = path.suffix.lower() == ".dae" and isinstance(error, (ImportError, NotImplementedError, ValueError))
        hint = "; COLLADA needs pycollada: pip install 'sgslam[mesh]'" if missing else ""
        raise UserError(f"{path}: cannot be read as a mesh ({type(error).__name__}){hint}") from None
    if triangles.ndim != 3 or triangles.shape[1:] != (3, 3):
        raise UserError(f"{path}: contains faces that are not triangles in 3D")
    if path.suffix.lower() == ".dae":
        triangles = _upright(triangles, path)
    if not len(triangles) or not np.isfinite(triangles).all():
        raise UserError(f"{path}: contains no triangles, or some that are not finite")
    return triangles


def _upright(triangles: NDArray[np.float64], path: Path) -> NDArray[np.float64]:
    """Converts to metres with z up, as stated by the file's `asset`."""
    import collada

    asset = collada.Collada(str(path), ignore=[collada.DaeError]).assetInfo
    axes = {"X_UP": (1, 2, 0), "Y_UP": (2, 0, 1), "Z_UP": (0, 1, 2)}[asset.upaxis or "Y_UP"]
    return np.asarray(triangles[:, :, axes] * (asset.unitmeter or 1.0))
