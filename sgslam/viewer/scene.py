"""The 3D scene of a run: the plan's storeys with the map on or beside them, and its matches."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from data import Floor, Room, SceneGraph, WallSurface
from data.trajectory import Trajectory
from sgslam.as_built.deviation_bands import BANDS
from sgslam.geometry.frames import se2_to_se3, transform_points
from sgslam.report.contents import BESIDE_GAP_M
from sgslam.report.plan_png import BAND_COLORS, BIM, MATCHED, PATHS, UNMATCHED
from sgslam.session import Snapshot
from sgslam.viewer.page import Colour, Page
from sgslam.viewer.scans import ScanClouds
from sgslam.viewer.shapes import (
    elevation_of,
    lower_edges,
    merge_meshes,
    path_lines,
    polygon_mesh,
    quad_mesh,
    ring_lines,
    wall_quads,
)

if TYPE_CHECKING:
    from sgslam.slam import SceneGraphSlam

Floats = NDArray[np.float64]
LAYERS = {
    "plan": "plan", "walls": "mapped walls", "rooms": "rooms", "names": "names", "scans": "scans",
    "trajectory": "trajectory", "matches": "matches", "truth": "truth",
}  # fmt: skip
ROOMS = ("#e6862b", "#3f78c9", "#45a35a", "#b45cc0", "#c9a227", "#2aa6a1", "#d65a5a", "#7a6fd0", "#8a9a2f", "#c4608f")
GHOSTS = 4  # hypotheses drawn
SCAN_POINTS = 4000  # of the newest scan, about
ABOVE_FLOOR = 0.02  # m, of filled areas, so that those of plan and map do not flicker


def rgb(text: str) -> Colour:
    """Parses a colour `#rrggbb`."""
    return int(text[1:3], 16), int(text[3:5], 16), int(text[5:7], 16)


def with_rooms(slam: "SceneGraphSlam") -> Snapshot:
    """The run as it is now. Without a plan, rooms are segmented only at the end, and now for this."""
    now = slam.snapshot()
    if now.plan is not None:
        return now
    graph = slam.s_graph()
    return replace(now, graphs=tuple(graph.on_floor(floor.id) for floor in graph.floors))


class RunScene:
    """The scene of one run.

    Its nodes are `/plan/<storey>/<layer>/...`, `/map/<floor>/<layer>/...`, `/matches/<floor>`, `/hypotheses/<n>` and
    `/truth`; the frame of `/map` follows the estimate of the map's pose. `lift` (m) raises the map above the plan;
    `bands` are the deviation bands of wall surfaces by id, see `deviation_bands`.
    """

    def __init__(self, page: Page) -> None:
        self.page = page
        self.scans = ScanClouds(page)
        self.lift = 0.0
        self.bands: dict[str, str] = {}
        self._plan: SceneGraph | None = None
        self._storeys: dict[str, str] = {}  # names on the page by id of the plan's storeys
        self._of_floor: dict[str, str] = {}  # storey of the plan by floor of the map
        self._storey: str | None = None
        self._ghosts: dict[int, str | None] = {}  # storeys of the drawn hypotheses
        self._hidden: set[str] = set()

    def clear(self) -> None:
        """Removes everything."""
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
        for floor in (plan.floors or (Floor("plan", ""),)) if plan is not None else ():
            self._storeys[floor.id] = _node_name(floor, set(self._storeys.values()))
            self._draw_storey(plan, floor)  # type: ignore[arg-type]
        if truth is not None and len(truth):
            self.page.lines("/truth", path_lines(truth.positions - self.page.origin), rgb(PATHS["truth"]["color"]), 1.5)

    def _draw_storey(self, plan: SceneGraph, floor: Floor) -> None:
        page, name = self.page, f"/plan/{self._storeys[floor.id]}"
        part = plan.on_floor(floor.id) if plan.floors else plan
        z = (floor.elevation or 0.0) - page.origin[2]
        corners = wall_quads(part.wall_surfaces, floor.elevation or 0.0, absolute=True) - page.origin
        page.frame(name)
        for layer in ("plan", "rooms", "names"):
            page.frame(f"{name}/{layer}", visible=layer not in self._hidden and (layer != "names" or self._names_shown))
        page.mesh(f"{name}/plan/walls", quad_mesh(corners), rgb(BIM), 0.25)
        page.lines(f"{name}/plan/feet", lower_edges(corners), rgb(BIM), 2.0)
        for number, room in enumerate(part.rooms):
            place = np.array([*room.centroid, floor.elevation or 0.0]) - page.origin + [0.0, 0.0, 0.1]
            page.label(f"{name}/names/{number}", room.name or room.id, place)
        page.lines(f"{name}/rooms/outlines", self._outlines(part.rooms, z), rgb("#d5dae0"), 1.0)

    def _outlines(self, rooms: tuple[Room, ...], z: float) -> Floats:
        return ring_lines([np.array(r.polygon) - self.page.origin[:2] for r in rooms if r.polygon], z)

    def show(self, now: Snapshot, sensor: Floats | None = None, new_clouds: int | None = None) -> None:
        """Draws the current map and, at `sensor` (4, 4) T_map_sensor, the sensor; at most `new_clouds` new scans."""
        self.show_plan(now.plan)
        page = self.page
        self._of_floor = {graph.floors[0].id: "" for graph in now.graphs} | now.storeys
        pairs, rooms = now.pairs("wall_surfaces"), now.pairs("rooms")
        tints = self._tints(set(rooms.values()))
        for floor in ["stairs", *self._of_floor]:
            page.frame(f"/map/{floor}")
            for layer in ("walls", "rooms", "scans", "trajectory"):
                page.frame(f"/map/{floor}/{layer}", visible=layer not in self._hidden)
        for graph in now.graphs:
            self._draw_floor(graph, pairs, {s: tints[a] for s, a in rooms.items() if a in tints})
        self._fill_planned({a: tints[a] for a in rooms.values() if a in tints})
        self.place(now)
        self.draw_path(now, len(now.poses) - 1)
        self._draw_hypotheses(now)
        self.scans.show(now.clouds, now.poses, now.floors, new_clouds)
        if sensor is not None:
            page.frame("/map/sensor", sensor, axes=0.6)
        self.show_storey(self._storey)

    def place(self, now: Snapshot) -> None:
        """Moves the map to its place, `lift` above the plan, and draws the match lines."""
        T_page_map, pairs = self._place(now), now.pairs("wall_surfaces")
        self.page.frame("/map", T_page_map)
        self.page.frame("/matches", visible="matches" not in self._hidden)
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

    def _tints(self, matched: set[str]) -> dict[str, Colour]:
        """A colour for each matched room of the plan, used in plan and map."""
        rooms = self._plan.rooms if self._plan is not None else ()
        return {r.id: rgb(ROOMS[k % len(ROOMS)]) for k, r in enumerate(rooms) if r.id in matched}

    def _draw_floor(self, graph: SceneGraph, pairs: dict[str, str], tints: dict[str, Colour]) -> None:
        page, floor = self.page, graph.floors[0]
        name, z = f"/map/{floor.id}", floor.elevation or 0.0
        looks = {"matched": MATCHED, "unmatched": UNMATCHED, **dict(zip(BANDS, BAND_COLORS, strict=True))}
        kinds: dict[str, list[WallSurface]] = {kind: [] for kind in looks}
        for surface in graph.wall_surfaces:
            kinds["unmatched" if surface.id not in pairs else self.bands.get(surface.id, "matched")].append(surface)
        for kind, colour in looks.items():
            corners = wall_quads(kinds[kind], z, absolute=False)
            page.mesh(f"{name}/walls/{kind}", quad_mesh(corners), rgb(colour), 0.5)
            page.lines(f"{name}/walls/{kind}-feet", lower_edges(corners), rgb(colour), 2.5)
        rings = ring_lines([r.polygon for r in graph.rooms if r.polygon], z)
        page.lines(f"{name}/rooms/outlines", rings, rgb(MATCHED), 1.0)
        self._fill(f"{name}/rooms", [(r, tints.get(r.id)) for r in graph.rooms], z + 2 * ABOVE_FLOOR, np.zeros(2))

    def _fill(self, name: str, rooms: list[tuple[Room, Colour | None]], z: float, origin: Floats) -> None:
        """Fills rooms, with one mesh for each colour."""
        of: dict[Colour, list[Room]] = {rgb(text): [] for text in ROOMS}
        for room, colour in rooms:
            if colour is not None and room.polygon:
                of[colour].append(room)
        for number, (colour, own) in enumerate(of.items()):
            mesh = merge_meshes([polygon_mesh(np.array(room.polygon) - origin, z) for room in own])
            self.page.mesh(f"{name}/areas-{number}", mesh, colour, 0.45)

    def _fill_planned(self, tints: dict[str, Colour]) -> None:
        for storey, called in self._storeys.items():
            assert self._plan is not None
            rooms = [(r, tints.get(r.id)) for r in self._plan.rooms if r.floor == storey or not self._plan.floors]
            z = elevation_of(self._plan, storey) + ABOVE_FLOOR - self.page.origin[2]
            self._fill(f"/plan/{called}/rooms", rooms, z, self.page.origin[:2])

    def _draw_matches(self, graph: SceneGraph, pairs: dict[str, str], T_page_map: Floats) -> None:
        """Draws lines from the centre of each matched wall surface to its planned one."""
        floor, planned = graph.floors[0], {} if self._plan is None else self._plan.surface_by_id
        found = [(s, planned[pairs[s.id]]) for s in graph.wall_surfaces if pairs.get(s.id) in planned]
        ours = wall_quads([s for s, _ in found], floor.elevation or 0.0, absolute=False).mean(axis=1)
        theirs = np.array([
            wall_quads([a], elevation_of(self._plan, a.floor) if self._plan else 0.0, absolute=True)[0].mean(axis=0)
            for _, a in found
        ]).reshape(-1, 3) - self.page.origin  # fmt: skip
        ends = np.stack([transform_points(T_page_map, ours), theirs], axis=1)
        self.page.lines(f"/matches/{floor.id}", ends, rgb(MATCHED), 2.0)

    def draw_path(self, now: Snapshot, last: int) -> None:
        """Draws the path through the keyframes up to index `last`, separately for each floor."""
        on = np.array([floor or "stairs" for floor in now.floors])
        ends = path_lines(now.poses[:, :3, 3])
        for floor in sorted(set(on.tolist())):
            own = (on[1:] == floor) & (np.arange(len(ends)) < last)
            self.page.lines(f"/map/{floor}/trajectory/way", ends[own], rgb(PATHS["trajectory"]["color"]), 3.0)

    def set_camera(self, now: Snapshot | None = None) -> None:
        """Points the camera at the plan and the map, from the south and above."""
        seen = np.empty((0, 3))
        if now is not None:
            walls = np.array([(*w.centroid, 0.0) for graph in now.graphs for w in graph.wall_surfaces]).reshape(-1, 3)
            seen = transform_points(self._place(now), np.concatenate([now.poses[:, :3, 3], walls]))
        planned = [(*w.centroid, self.page.origin[2]) for w in self._plan.wall_surfaces] if self._plan else []
        everything = np.concatenate([seen, np.array(planned).reshape(-1, 3) - self.page.origin])
        if not len(everything):
            return
        low, high = everything.min(axis=0), everything.max(axis=0)
        if now is None:
            low[0] -= (high - low)[:2].max() / 2  # room for the map beside the plan
        size = max(float((high - low)[:2].max()), 4.0)
        middle = (low + high) / 2 + size * np.array([0.2, -0.05, 0.0])
        self.page.set_camera(middle, middle + size * np.array([0.0, -0.5, 0.6]))

    def _draw_hypotheses(self, now: Snapshot) -> None:
        """Draws the map's walls on the plan at each match hypothesis."""
        graphs = {graph.floors[0].id: graph for graph in now.graphs}
        matches = now.hypotheses if self._plan is not None else ()
        drawn = [(graphs[floor], match) for floor, match in matches if floor in graphs]
        for number in range(GHOSTS):
            ends = np.empty((0, 2, 3))
            if number < len(drawn) and self._plan is not None:
                graph, hypothesis = drawn[number]
                yaw, x, y = hypothesis["T_a_s"]
                z = elevation_of(self._plan, hypothesis.get("floor"))
                corners = wall_quads(graph.wall_surfaces, 0.0, absolute=False)
                ends = transform_points(se2_to_se3(yaw, x, y, z), lower_edges(corners)) - self.page.origin
                self._ghosts[number] = hypothesis.get("floor")
            self.page.lines(f"/hypotheses/{number + 1}", ends, rgb(ROOMS[number]), 4.0 - 0.7 * number)

    def show_storey(self, storey: str | None) -> None:
        """Shows only the storey with this id and the map on it; None shows all storeys and the stairs. With several
        storeys the room names are hidden: they would overlap."""
        self._storey = storey
        self.page.hide("/map/stairs", storey is not None)
        for own, called in self._storeys.items():
            self.page.hide(f"/plan/{called}", storey not in (None, own))
            self.page.hide(f"/plan/{called}/names", not self._names_shown)
        for number, of in self._ghosts.items():
            self.page.hide(f"/hypotheses/{number + 1}", storey not in (None, of))
        for floor, own in self._of_floor.items():
            hidden = storey is not None and storey not in (floor, own) and (own != "" or not self._storeys)
            self.page.hide(f"/map/{floor}", hidden)
            self.page.hide(f"/matches/{floor}", hidden)

    def show_layer(self, layer: str, shown: bool) -> None:
        """Shows or hides one of `LAYERS`."""
        (self._hidden.discard if shown else self._hidden.add)(layer)
        for name in self.page.names:
            if name.rpartition("/")[2] == layer and name.count("/") in (1, 3):
                self.page.hide(name, not shown or (layer == "names" and not self._names_shown))

    @property
    def _names_shown(self) -> bool:
        return "names" not in self._hidden and (self._storey is not None or len(self._storeys) < 2)


def _node_name(floor: Floor, taken: set[str]) -> str:
    """A storey's name for a node, with its id if the name is taken."""
    name = (floor.name or floor.id).replace("/", "-")
    return name if name not in taken else f"{name} {floor.id.replace('/', '-')}"
