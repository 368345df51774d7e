"""The 3D scene of a run: the plan's storeys with the map on or beside them, and its matches."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from data import Floor, Room, SceneGraph, WallSurface
from data.geometry.areas import polygons_of, triangles_of
from data.scene_graph import WALL_HEIGHT
from data.trajectory import Trajectory
from sgslam.as_built.deviation_bands import BANDS
from sgslam.geometry.frames import se2_to_se3, transform_points
from sgslam.report.contents import BESIDE_GAP_M, DRAWN_HYPOTHESES
from sgslam.report.plan_png import BAND_COLORS, BIM, MATCHED, PATHS, UNMATCHED
from sgslam.session import Snapshot
from sgslam.viewer.canvas import Canvas, rgb
from sgslam.viewer.scans import ScanClouds

Floats = NDArray[np.float64]
LAYERS = ("plan", "walls", "rooms", "names", "scans", "trajectory", "matches", "truth")
ROOMS = ("#e6862b", "#3f78c9", "#45a35a", "#b45cc0", "#c9a227", "#2aa6a1", "#d65a5a", "#7a6fd0", "#8a9a2f", "#c4608f")
_SCAN_POINTS = 4000  # of the newest scan, about
_ABOVE_FLOOR = 0.02  # m, of filled areas, so that those of plan and map do not flicker
_RED = "#d64045"


class RunScene:
    """The scene of one run.

    Its nodes are `/plan/<storey>/<layer>/...`, `/map/<floor>/<layer>/...`, `/matches/<floor>`, `/hypotheses/<n>` and
    `/truth`; the frame of `/map` follows the estimate of the map's pose. `lift` (m) raises the map above the plan;
    `bands` are the deviation bands of wall surfaces by id, see `deviation_bands`.
    """

    def __init__(self, page: Canvas) -> None:
        self.page = page
        self.scans = ScanClouds(page)
        self.lift = 0.0
        self.bands: dict[str, str] = {}
        self._plan: SceneGraph | None = None
        self._storeys: dict[str, str] = {}  # names on the page by id of the plan's storeys
        self._of_floor: dict[str, str] = {}  # storey of the plan by floor of the map
        self._storey: str | None = None
        self._ghosts: dict[str, str | None] = {}  # storeys of the drawn hypotheses, by their numbers
        self._hidden: set[str] = set()

    def clear(self) -> None:
        self.scans.clear()
        for name in ("/plan", "/map", "/matches", "/hypotheses", "/truth"):
            self.page.remove(name)
        self._plan, self._storeys, self._of_floor = None, {}, {}

    @property
    def storeys(self) -> dict[str, str]:
        """The names of the plan's storeys by id; without a plan, the map's floors."""
        return self._storeys or {floor: floor for floor in self._of_floor}

    def show_plan(self, plan: SceneGraph | None, truth: Trajectory | None = None) -> None:
        """Draws the plan, unless it is drawn already, and sets the page's origin to its centre."""
        if plan is not None and plan is self._plan:
            return
        self.clear()
        self._plan = plan
        if plan is not None:
            low = min((f.elevation for f in plan.floors if f.elevation is not None), default=0.0)
            self.page.origin = np.array([*np.round(plan.centroid()), low])
            for floor in plan.floors or (Floor("plan", ""),):
                self._storeys[floor.id] = _node_name(floor, set(self._storeys.values()))
                self._draw_storey(plan, floor)
            self._draw_planned_rooms({})
        if truth is not None and len(truth):
            self.page.lines("/truth", path_lines(truth.positions - self.page.origin), rgb(PATHS["truth"]["color"]), 1.5)

    def _draw_storey(self, plan: SceneGraph, floor: Floor) -> None:
        name, ground = f"/plan/{self._storeys[floor.id]}", floor.elevation or 0.0
        part = plan.on_floor(floor.id) if plan.floors else plan
        corners = wall_quads(part.wall_surfaces, ground, absolute=True) - self.page.origin
        self._draw_walls(f"{name}/plan/walls", corners, BIM, 0.25, 2.0)
        for number, room in enumerate(part.rooms):
            place = np.array([*room.centroid, ground + 0.1]) - self.page.origin
            self.page.label(f"{name}/names/{number}", room.name or room.id, place)

    def _draw_walls(self, name: str, corners: Floats, colour: str, opacity: float, width: float) -> None:
        self.page.mesh(name, quad_triangles(corners), rgb(colour), opacity)
        self.page.lines(f"{name}-feet", corners[:, :2], rgb(colour), width)

    def _draw_rooms(
        self, name: str, rooms: Sequence[Room], tints: dict[str, str], z: float, colour: str, origin: Floats
    ) -> None:
        """Draws the outlines of rooms, and fills those that have a tint, with one mesh for each colour."""
        rings = {room.id: np.array(room.polygon) - origin for room in rooms if room.polygon}
        self.page.lines(f"{name}/outlines", ring_lines(rings.values(), z), rgb(colour), 1.0)
        for number, tint in enumerate(ROOMS):
            own = [ring for room, ring in rings.items() if tints.get(room) == tint]
            areas = [np.empty((0, 3, 3)), *(polygon_triangles(ring, z + _ABOVE_FLOOR) for ring in own)]
            self.page.mesh(f"{name}/areas-{number}", np.concatenate(areas), rgb(tint), 0.45)

    def _draw_planned_rooms(self, tints: dict[str, str]) -> None:
        plan = self._plan or SceneGraph("bim")
        for storey, called in self._storeys.items():
            rooms = [room for room in plan.rooms if room.floor == storey or not plan.floors]
            z = elevation_of(self._plan, storey) - self.page.origin[2]
            self._draw_rooms(f"/plan/{called}/rooms", rooms, tints, z, "#d5dae0", self.page.origin[:2])

    def show(self, now: Snapshot, new_clouds: int | None = None) -> None:
        """Draws the current map; at most `new_clouds` new scans."""
        self.show_plan(now.plan)
        self._of_floor = {graph.floors[0].id: "" for graph in now.graphs} | now.storeys
        pairs, rooms = now.pairs("wall_surfaces"), now.pairs("rooms")
        planned = enumerate(self._plan.rooms if self._plan is not None else ())
        tints = {room.id: ROOMS[k % len(ROOMS)] for k, room in planned if room.id in set(rooms.values())}
        looks = {"matched": MATCHED, "unmatched": UNMATCHED, **dict(zip(BANDS, BAND_COLORS, strict=True))}
        for graph in now.graphs:
            name, z = f"/map/{graph.floors[0].id}", graph.floors[0].elevation or 0.0
            kinds: dict[str, list[WallSurface]] = {kind: [] for kind in looks}
            for surface in graph.wall_surfaces:
                kinds["unmatched" if surface.id not in pairs else self.bands.get(surface.id, "matched")].append(surface)
            for kind, colour in looks.items():
                self._draw_walls(f"{name}/walls/{kind}", wall_quads(kinds[kind], z, absolute=False), colour, 0.5, 2.5)
            matched = {s: tints[a] for s, a in rooms.items() if a in tints}
            self._draw_rooms(f"{name}/rooms", graph.rooms, matched, z + _ABOVE_FLOOR, MATCHED, np.zeros(2))
        self._draw_planned_rooms(tints)
        self.place(now)
        self.draw_path(now, len(now.poses) - 1)
        self._draw_hypotheses(now)
        self.scans.show(now.clouds, now.poses, now.floors, new_clouds)
        self.show_storey(self._storey)

    def show_sensor(self, T_map_sensor: Floats, points: NDArray[np.floating], T_map_points: Floats) -> None:
        """Draws the sensor, and some of the points (N, 3) that it measured at (4, 4) T_map_points."""
        self.page.frame("/map/sensor", T_map_sensor, axes=0.6)
        some = points[:: max(1, len(points) // _SCAN_POINTS)]
        self.page.points("/map/scan", some, rgb(_RED), T_map_points, 0.03)

    def place(self, now: Snapshot) -> None:
        """Moves the map to its place, `lift` above the plan, and draws the match lines."""
        T_page_map, pairs = self._place(now), now.pairs("wall_surfaces")
        self.page.frame("/map", T_page_map)
        for graph in now.graphs:
            self._draw_matches(graph, pairs, T_page_map)

    def _place(self, now: Snapshot) -> Floats:
        """(4, 4) T_page_map: in the plan, or beside it while the map is not placed."""
        T = np.eye(4) if now.T_plan_map is None else now.T_plan_map.copy()
        if now.T_plan_map is None and now.plan is not None and len(now.poses):
            planned = np.array([w.centroid for w in now.plan.wall_surfaces] or [(0.0, 0.0)])
            seen = [w.centroid for graph in now.graphs for w in graph.wall_surfaces]
            ours = np.concatenate([now.poses[:, :2, 3], np.array(seen).reshape(-1, 2)])
            T[0, 3] = planned[:, 0].min() - ours[:, 0].max() - BESIDE_GAP_M  # the panel covers the right
            T[1, 3] = planned[:, 1].mean() - (ours[:, 1].min() + ours[:, 1].max()) / 2
            T[2, 3] = self.page.origin[2] - min((g.floors[0].elevation or 0.0 for g in now.graphs), default=0.0)
        T[:3, 3] += [0.0, 0.0, self.lift] - self.page.origin
        return T

    def _draw_matches(self, graph: SceneGraph, pairs: dict[str, str], T_page_map: Floats) -> None:
        """Draws lines from the centre of each matched wall surface to its planned one."""
        floor, planned = graph.floors[0], {} if self._plan is None else self._plan.surface_by_id
        found = [(s, planned[pairs[s.id]]) for s in graph.wall_surfaces if pairs.get(s.id) in planned]
        ours = wall_quads([s for s, _ in found], floor.elevation or 0.0, absolute=False).mean(axis=1)
        theirs = [wall_quads([a], elevation_of(self._plan, a.floor), absolute=True)[0].mean(axis=0) for _, a in found]
        ends = [transform_points(T_page_map, ours), np.array(theirs).reshape(-1, 3) - self.page.origin]
        self.page.lines(f"/matches/{floor.id}", np.stack(ends, axis=1), rgb(MATCHED), 2.0)

    def draw_path(self, now: Snapshot, last: int) -> None:
        """Draws the path through the keyframes up to index `last`, separately for each floor."""
        on = np.array([floor or "stairs" for floor in now.floors])
        ends = path_lines(now.poses[:, :3, 3])
        for floor in sorted(set(on.tolist())):
            own = (on[1:] == floor) & (np.arange(len(ends)) < last)
            self.page.lines(f"/map/{floor}/trajectory/way", ends[own], rgb(PATHS["trajectory"]["color"]), 3.0)

    def extent(self, now: Snapshot | None = None) -> Floats:
        """(N, 3) places of the plan and the map, on the page."""
        seen = np.empty((0, 3))
        if now is not None:
            walls = np.array([(*w.centroid, 0.0) for graph in now.graphs for w in graph.wall_surfaces]).reshape(-1, 3)
            seen = transform_points(self._place(now), np.concatenate([now.poses[:, :3, 3], walls]))
        planned = [(*w.centroid, self.page.origin[2]) for w in self._plan.wall_surfaces] if self._plan else []
        return np.concatenate([seen, np.array(planned).reshape(-1, 3) - self.page.origin])

    def _draw_hypotheses(self, now: Snapshot) -> None:
        """Draws the map's walls on the plan at each match hypothesis."""
        graphs = {graph.floors[0].id: graph for graph in now.graphs}
        matches = now.hypotheses if self._plan is not None else ()
        drawn = [(graphs[floor], match) for floor, match in matches if floor in graphs][:DRAWN_HYPOTHESES]
        self._ghosts = {str(number): match.get("floor") for number, (_, match) in enumerate(drawn, 1)}
        for number in range(DRAWN_HYPOTHESES):
            ends = np.empty((0, 2, 3))
            if number < len(drawn):
                graph, match = drawn[number]
                yaw, x, y = match["T_a_s"]
                T = se2_to_se3(yaw, x, y, elevation_of(self._plan, match.get("floor")))
                corners = wall_quads(graph.wall_surfaces, 0.0, absolute=False)
                ends = transform_points(T, corners[:, :2]) - self.page.origin
            self.page.lines(f"/hypotheses/{number + 1}", ends, rgb(ROOMS[number]), 4.0 - 0.7 * number)

    def show_storey(self, storey: str | None) -> None:
        """Shows only the storey with this id and the map on it; None shows all storeys and the stairs. With several
        storeys the room names are hidden: they would overlap."""
        self._storey = storey
        for name in self.page.names:
            _, top, *below = name.split("/")
            layer = below[1] if len(below) == 2 else top if not below else ""
            if layer in LAYERS and (len(below) == 2 or layer in ("matches", "truth")):
                overlaps = layer == "names" and storey is None and len(self._storeys) > 1
                self.page.hide(name, layer in self._hidden or overlaps)
            elif len(below) == 1:
                self.page.hide(name, storey is not None and self._is_elsewhere(top, below[0], storey))

    def _is_elsewhere(self, top: str, own: str, storey: str) -> bool:
        """Whether a node below `/plan`, `/map`, `/matches` or `/hypotheses` is not on this storey."""
        if top == "plan":
            return own != self._storeys.get(storey)
        if top == "hypotheses":
            return self._ghosts.get(own) != storey
        on = self._of_floor.get(own)
        if on is None:
            return own == "stairs"
        return storey not in (own, on) and (on != "" or not self._storeys)

    def show_layer(self, layer: str, shown: bool) -> None:
        """Shows or hides one of `LAYERS`."""
        (self._hidden.discard if shown else self._hidden.add)(layer)
        self.show_storey(self._storey)


def _node_name(floor: Floor, taken: set[str]) -> str:
    """A storey's name for a node, with its id if the name is taken."""
    name = (floor.name or floor.id).replace("/", "-")
    return name if name not in taken else f"{name} {floor.id.replace('/', '-')}"


def elevation_of(graph: SceneGraph | None, floor: str | None) -> float:
    """The elevation (m) of a floor; 0 if unknown."""
    floors = graph.floors if graph is not None else ()
    return next((f.elevation for f in floors if f.id == floor and f.elevation is not None), 0.0)


def wall_quads(surfaces: Sequence[WallSurface], below: float, absolute: bool) -> Floats:
    """(N, 4, 3) corners of wall surfaces, around each: two below, two above. Heights are `absolute` z, as in a plan, or
    relative to the floor at z = `below`."""
    corners = np.empty((len(surfaces), 4, 3))
    for row, surface in zip(corners, surfaces, strict=True):
        low, high = surface.height or (0.0, WALL_HEIGHT)
        if surface.height is None or not absolute:
            low, high = low + below, high + below
        row[:, :2] = np.array(surface.ends())[[0, 1, 1, 0]]
        row[:, 2] = low, low, high, high
    return corners


def quad_triangles(corners: Floats) -> Floats:
    """(2 N, 3, 3) the triangles of quadrilaterals (N, 4, 3)."""
    return corners[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3, 3)


def ring_lines(rings: Iterable[Any], z: float) -> Floats:
    """(N, 2, 3) the edges of open rings, each (K, 2), at height `z`."""
    sides = [np.empty((0, 2, 2))]
    for ring in rings:
        points = np.asarray(ring, dtype=float)
        sides.append(np.stack([points, np.roll(points, -1, axis=0)], axis=1))
    flat = np.concatenate(sides)
    return np.concatenate([flat, np.full((*flat.shape[:2], 1), z)], axis=2)


def polygon_triangles(ring: Any, z: float) -> Floats:
    """(T, 3, 3) the triangles of the area within a ring (K, 2) at height `z`; none for an area of zero."""
    flat = triangles_of(polygons_of(shapely.Polygon(ring if len(ring) > 2 else ())))
    return np.concatenate([flat, np.full((len(flat), 3, 1), z)], axis=2)


def path_lines(points: Floats) -> Floats:
    """(N - 1, 2, 3) the segments of the path through points (N, 3)."""
    return np.stack([points[:-1], points[1:]], axis=1)
