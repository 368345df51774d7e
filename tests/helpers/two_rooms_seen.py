"""Two rooms with a door in the wall between them and a column, and what a LiDAR that is carried there sees."""

from typing import Any

import numpy as np
from boxes import triangles_of
from numpy.typing import NDArray

from data.geometry.raycast import TriangleScene
from data.plans.bodies import PlannedElement
from data.scene_graph import SceneGraph
from sgslam.as_built import AnchoredMap, Assessment, assess
from sgslam.as_built.elements.rays import View

Floats = NDArray[np.float64]
Corner = tuple[float, float, float]
Places = tuple[tuple[float, float], ...]
POSE_SIGMA, NOISE = 0.004, 0.02  # m, of poses and ranges
HEADING_SIGMA = 0.0009  # rad
HEIGHT, LINTEL = 2.8, 2.1  # m
NEAR, FAR = 3.0, 3.2  # m, x of the faces of the wall between the rooms
JAMBS = (-0.5, 0.5)  # m, y
COLUMN, SIDE = (0.6, 1.4), 0.3  # m, x, y of its middle, and its width
NEAR_ROOM: Places = tuple((x, y) for x in (-1.5, 0.0, 1.5) for y in (-2.0, -0.7, 0.7, 2.3))
FAR_ROOM: Places = tuple((x, y) for x in (4.4, 5.5, 6.6) for y in (-1.7, 0.0, 1.7))
BOTH = NEAR_ROOM + FAR_ROOM
NOTHING = np.empty((0, 3, 3))


def box(low: Corner, high: Corner) -> Floats:
    """(12, 3, 3) the triangles of a cuboid."""
    return triangles_of([(*low, *high)])


def wall_with_door(along: float = 0.0, across: float = 0.0) -> Floats:
    """The wall between the rooms, with its door displaced along it, and the whole displaced across."""
    start, end = (jamb + along for jamb in JAMBS)
    low, high = NEAR + across, FAR + across
    pieces = [(low, -3.0, 0.0, high, start, HEIGHT), (low, end, 0.0, high, 3.0, HEIGHT)]
    return triangles_of([*pieces, (low, start, LINTEL, high, end, HEIGHT)])


WALL = wall_with_door()


def column(x: float = 0.0, y: float = 0.0) -> Floats:
    """The column, displaced by so much."""
    low, high = (np.add(COLUMN, [x, y]) + sign * SIDE / 2 for sign in (-1, 1))
    return box((*low, 0.0), (*high, HEIGHT))


def leaf(set_back: float = 0.0, degrees: float = 0.0) -> Floats:
    """A leaf of 4 cm, behind the near face, or swung open into the near room by an angle about its right jamb."""
    shut = box((NEAR + set_back, JAMBS[0] + 0.001, 0.0), (NEAR + set_back + 0.04, JAMBS[1] - 0.001, LINTEL))
    hinge = np.array([NEAR + set_back, JAMBS[0], 0.0])
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return (shut - hinge) @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + hinge


_SIDES = [(x, x + 0.2, -3.2, 3.2, -0.2, 3.0) for x in (-3.2, 8.0)]
_SIDES += [(-3.2, 8.2, y, y + 0.2, -0.2, 3.0) for y in (-3.2, 3.0)]
_SIDES += [(-3.2, 8.2, -3.2, 3.2, z, z + 0.2) for z in (-0.2, HEIGHT)]
SHELL = np.concatenate([box((x, y, z), (to_x, to_y, to_z)) for x, to_x, y, to_y, z, to_z in _SIDES])


def views_of(*built: Floats, places: Places = BOTH) -> list[View]:
    """One from each place (x, y) of what stands, thinned to a point in each voxel of 0.1 m, with errors of its pose."""
    scene, rng = TriangleScene(np.concatenate(built)), np.random.default_rng(0)
    return [_view(scene, place, rng) for place in places]


def _view(scene: TriangleScene, place: tuple[float, float], rng: np.random.Generator) -> View:
    azimuth = np.arange(900) * 2 * np.pi / 900 + rng.uniform(0.0, 0.01)
    a, e = (part.ravel() for part in np.meshgrid(azimuth, np.radians(np.linspace(-15, 15, 16))))
    rays = np.column_stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    true = np.array([*place, 1.2])
    ranges = scene.distances(true, rays)
    met = np.isfinite(ranges)
    points = (ranges[met] + rng.normal(0.0, NOISE, met.sum()))[:, None] * rays[met]
    _, kept = np.unique(np.floor(points / 0.1).astype(int), axis=0, return_index=True)
    T = np.eye(4)
    T[:3, 3] = np.add(true, [*rng.normal(0.0, POSE_SIGMA, 2), 0.0])
    turn = rng.normal(0.0, HEADING_SIGMA)
    T[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    return View(points[kept].astype(np.float32), T, np.full(3, POSE_SIGMA), HEADING_SIGMA)


def planned(set_back: float | None = None) -> list[PlannedElement]:
    """Wall, shell, column and door, whose leaf is planned so far behind the near face."""
    body = box((NEAR - 0.05, JAMBS[0], 0.0), (FAR + 0.05, JAMBS[1], LINTEL))
    filling = None if set_back is None else leaf(set_back)
    solids = [("wall", "IfcWall", wall_with_door()), ("shell", "IfcWall", SHELL), ("column", "IfcColumn", column())]
    return [
        *(PlannedElement(name, kind, "", "", "solid", triangles) for name, kind, triangles in solids),
        PlannedElement("door", "IfcDoor", "", "", "opening", body, wall="wall", filling=filling),
    ]


def assessed(
    elements: list[PlannedElement], views: list[View], tolerance: float = 0.01, others: Floats = NOTHING, **of: Any
) -> Assessment:
    """What such views say of the elements; the map's frame is the BIM frame. `of` are fields of the map in its plan."""
    graphs = {"s_graph": SceneGraph("map"), "plan": SceneGraph("bim"), "matches": None} | of
    run = AnchoredMap(T_bim_map=np.eye(4), views=views, **graphs)
    return assess(run, elements, others, tolerance, shared=0.004)
