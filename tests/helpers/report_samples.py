"""A run to report on: a building, its map, a drive through it; and a reader of the page."""

import dataclasses
from collections import Counter
from html.parser import HTMLParser
from typing import Any

import numpy as np

from data.geometry.poses import poses_to_xyzquat, xyzquat_to_poses
from data.scene_graph import Floor, Keyframe, Room, SceneGraph, WallSurface
from data.trajectory import Trajectory
from sgslam.report import ReportData
from sgslam.report.scan_states import ScanStates

HOSTILE = "<script>alert('x')</script> & \"Söhne\" $\\frac$"
ORIGIN = np.array([3_468_000.0, 5_427_000.0])  # a site's place in a national grid
SEVEN = [12.0, 3.0, 4.0, 0.0, 0.0, np.sin(0.3), np.cos(0.3)]  # x y z and a turn of 0.6 rad about z


def rectangle(room: str, x: float, y: float, dx: float, dy: float, floor: str) -> list[WallSurface]:
    sides = [((x + dx / 2, y), (0.0, 1.0), dx), ((x + dx / 2, y + dy), (0.0, -1.0), dx),
             ((x, y + dy / 2), (1.0, 0.0), dy), ((x + dx, y + dy / 2), (-1.0, 0.0), dy)]  # fmt: skip
    return [
        WallSurface(f"{room}.{i}", room, centre, normal, length, floor)
        for i, (centre, normal, length) in enumerate(sides)
    ]


def building(rooms_a_side: int = 4, storeys: int = 2) -> SceneGraph:
    """Storeys 3.5 m apart: a corridor along x with rooms of several widths on both its sides."""
    rooms, walls = [], []
    for k in range(storeys):
        x = 0.0
        floor = f"F{k}"
        for i in range(rooms_a_side):
            width = 3.0 + (i * 7 % 4)
            for side, y, depth in (("n", 2.4, 5.0), ("s", -5.2, 5.0)):
                name = f"r{k}{side}{i}"
                corners = ((x, y), (x + width, y), (x + width, y + depth), (x, y + depth))
                centre = (x + width / 2, y + depth / 2)
                rooms.append(Room(name, centre, floor, f"Office {k}{i}{side}", corners))
                walls += rectangle(name, x, y, width, depth, floor)
            x += width + 0.2
        corners = ((0.0, 0.0), (x, 0.0), (x, 2.2), (0.0, 2.2))
        rooms.append(Room(f"c{k}", (x / 2, 1.1), floor, "Corridor", corners))
        walls += rectangle(f"c{k}", 0, 0, x, 2.2, floor)
    floors = tuple(Floor(f"F{k}", f"Storey {k}", 3.5 * k) for k in range(storeys))
    return SceneGraph("bim", tuple(rooms), tuple(walls), (), floors)


def into_map(xy: tuple[float, float]) -> tuple[float, float]:
    T_map_bim = np.linalg.inv(xyzquat_to_poses(SEVEN))
    x, y, _, _ = T_map_bim @ [*xy, 4.0, 1.0]
    return float(x), float(y)


def mapped(a_graph: SceneGraph, floor: str = "F1") -> SceneGraph:
    """The storey as a robot maps it, with ids of its own and one cupboard that no plan knows."""
    yaw = -0.6
    R = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    seen = a_graph.on_floor(floor)
    rooms = [
        Room(f"S{r.id}", into_map(r.centroid), None, f"room {i}", tuple(into_map(p) for p in r.polygon or ()))
        for i, r in enumerate(seen.rooms)
    ]
    walls = []
    for w in seen.wall_surfaces:
        nx, ny = (R @ w.normal).tolist()
        walls.append(WallSurface(f"S{w.id}", f"S{w.room}", into_map(w.centroid), (nx, ny), w.length))
        walls[-1] = dataclasses.replace(walls[-1], height=(0.1, 1.6))
    walls.append(WallSurface("Scupboard", None, into_map((6.0, -3.0)), (1.0, 0.0), None))
    return SceneGraph("map", tuple(rooms), tuple(walls), (), (Floor("floor-0", "", -0.5),))


def drive(count: int = 500) -> Trajectory:
    """In the BIM frame, 0.5 m above the floor at 3.5 m: along the corridor and into a room."""
    s = np.linspace(0, 1, count)
    rows = np.zeros((count, 7))
    rows[:, 0], rows[:, 2], rows[:, 6] = 1 + 14 * s, 4.0, 1
    rows[:, 1] = 1.1 + 0.3 * np.sin(20 * s) + 3.5 * np.clip((s - 0.8) / 0.2, 0, 1)
    return Trajectory(np.arange(count) * 100_000_000, xyzquat_to_poses(rows))


def sample(count: int = 500, rooms_a_side: int = 4) -> ReportData:
    """An anchored run: every surface of the storey matched, the odometry, in its own frame, turning away."""
    a_graph = building(rooms_a_side)
    s_graph = mapped(a_graph)
    truth = drive(count)
    T_bim_map = xyzquat_to_poses(SEVEN)
    trajectory = truth.transformed(np.linalg.inv(T_bim_map))
    poses = poses_to_xyzquat(trajectory.poses[::10]).tolist()
    keyframes = tuple(Keyframe(f"k{i}", i, tuple(pose)) for i, pose in enumerate(poses))
    s_graph = dataclasses.replace(s_graph, keyframes=keyframes)
    matches = {
        "status": "unique", "reason": "one motion explains 9 rooms", "floor": "F1", "T_a_s": [0.6, 12.0, 3.0],
        "rooms": [[r.id, r.id[1:], 0.97] for r in s_graph.rooms],
        "wall_surfaces": [[w.id, w.id[1:], 0.9] for w in s_graph.wall_surfaces if w.id != "Scupboard"],
        "hypotheses": [
            {"score": 31.5, "T_a_s": [0.6, 12.0, 3.0], "floor": "F1", "rooms": [["Sc1", "c1"]]},
            {"score": 30.9, "T_a_s": [3.74, 5.0, -3.0], "floor": "F0", "rooms": []},
        ],
    }  # fmt: skip
    metrics = {
        "anchored": True, "reason": "anchored to Storey 1 with 9 rooms and 36 wall surfaces",
        "T_bim_map": SEVEN, "scans": count, "scans_skipped": 1, "keyframes": 61,
        "rooms": len(s_graph.rooms), "wall_surfaces": len(s_graph.wall_surfaces), "first_anchor_s": 14.2,
        "seconds": {"total": 9.31, "reading": 0.12, "odometry": 5.2, "surfaces": 1.1, "rooms": 0.44,
                    "matching": 0.9, "optimisation": 0.61, "bim": 0.8, "report": 0.14},
        "accuracy": {"rmse_bim_m": 0.0123, "max_bim_m": 0.041, "yaw_rmse_bim_deg": 0.11,
                     "rmse_odometry_aligned_m": 0.084, "matched_poses": count, "total_poses": count},
    }  # fmt: skip
    half_turn = np.linspace(0, 0.05, count)
    turn = np.zeros((count, 7))
    turn[:, 5], turn[:, 6] = np.sin(half_turn), np.cos(half_turn)
    start = trajectory.poses[0]
    odometry = Trajectory(trajectory.stamps_ns, xyzquat_to_poses(turn) @ np.linalg.inv(start) @ trajectory.poses)
    found = deviations(s_graph)
    states = ScanStates(
        np.arange(count) / 10, np.zeros(count, bool), np.zeros(count, np.int64), np.full((count, 2), 0.004)
    )
    anchors = [anchor(w.id, w.id[1:]) for w in s_graph.wall_surfaces if w.id != "Scupboard"]
    return ReportData(
        a_graph, s_graph, trajectory, odometry, truth, T_bim_map, matches, metrics, found, states, anchors
    )


def anchor(wall: str, a_id: str, withdrawn: str | None = None) -> dict[str, Any]:
    """An anchor of a wall; `withdrawn` is why it holds no more."""
    events = [{"stamp_ns": 14_200_000_000, "state": "tight", "why": "as planned within 25 mm"}]
    if withdrawn is not None:
        events.append({"stamp_ns": 30_000_000_000, "state": "withdrawn", "why": withdrawn})
    return {"wall": wall, "a_id": a_id, "by": "match 1", "state": events[-1]["state"], "events": events}


def with_lost_scans(data: ReportData) -> ReportData:
    """Scans 100 to 129 are lost; 400 to 449 lie in a part that was not placed, which is laid at the last known pose."""
    assert data.scans is not None
    lost, part = data.scans.lost.copy(), data.scans.part.copy()
    lost[100:130], part[400:450] = True, 1
    poses = data.trajectory_map.poses.copy()
    poses[400:450, 0, 3] = poses[399, 0, 3] - 0.1 * np.arange(50)
    poses[400:450, 1, 3] = poses[399, 1, 3]
    scans = dataclasses.replace(data.scans, lost=lost, part=part)
    trajectory = Trajectory(data.trajectory_map.stamps_ns, poses)
    return dataclasses.replace(data, scans=scans, trajectory_map=trajectory)


def on_two_floors(placed: bool) -> ReportData:
    """First on the lower storey, then on the upper one, `placed` in the plan or not; between them, on none."""
    data = sample()
    assert data.a_graph is not None
    parts = [mapped(data.a_graph, storey) for storey in ("F0", "F1")]
    ids = ("floor-0", "floor-1")
    rooms, walls = (
        tuple(
            dataclasses.replace(item, floor=floor)
            for part, floor in zip(parts, ids, strict=True) for item in getattr(part, kind)
            if item.id != "Scupboard"
        )
        for kind in ("rooms", "wall_surfaces")
    )  # fmt: skip
    on = ["floor-0"] * 20 + [None] * 10 + ["floor-1"] * 20
    keyframes = tuple(
        dataclasses.replace(k, stamp_ns=1_000_000_000 * i, floor=on[i]) for i, k in enumerate(data.s_graph.keyframes)
    )
    floors = (Floor("floor-0", "", -4.0), Floor("floor-1", "", -0.5))
    s_graph = SceneGraph("map", rooms, walls, (), floors, keyframes)
    found = [w for w in walls if placed or w.floor == "floor-0"]
    matches = dict(data.matches or {}) | {
        "floor": "F0", "floors": {"floor-0": "F0"} | ({"floor-1": "F1"} if placed else {}),
        "rooms": [[r.id, r.id[1:], 0.97] for r in rooms if placed or r.floor == "floor-0"],
        "wall_surfaces": [[w.id, w.id[1:], 0.9] for w in found],
    }  # fmt: skip
    anchors = [anchor(w.id, w.id[1:]) for w in found]
    return dataclasses.replace(data, s_graph=s_graph, matches=matches, deviations=[], anchors=anchors)


def deviations(s_graph: SceneGraph) -> list[dict[str, Any]]:
    """Walls within 2 mm but for two, one that is not there, and a cupboard."""
    found: list[dict[str, Any]] = []
    for i, w in enumerate(s_graph.wall_surfaces):
        offset = {5: -0.1234, 7: 0.045}.get(i, 0.001 * (i % 5 - 2))
        found.append({
            "s_id": w.id, "a_id": w.id[1:], "source": f"guid-{i}", "kind": "moved", "offset_m": offset,
            "tilt_rad": 0.01 if i == 5 else 0.0, "sigma_m": 0.01, "significant": abs(offset) > 0.03,
        })  # fmt: skip
    nothing = {"offset_m": None, "tilt_rad": None, "sigma_m": None, "significant": True}
    found[-1] |= {"a_id": None, "source": None, "kind": "extra", **nothing}
    absent = {"s_id": None, "a_id": "r1n0.0", "source": "guid-absent", "kind": "absent", **nothing}
    return [*found, absent]


def not_anchored(status: str) -> ReportData:
    data = sample()
    matches = dict(data.matches or {}, status=status, reason="two places fit alike")
    if status == "none":
        matches |= {"rooms": [], "wall_surfaces": [], "T_a_s": None, "floor": None, "hypotheses": []}
    metrics = data.metrics | {"anchored": False, "reason": "two places fit alike", "T_bim_map": None}
    return dataclasses.replace(data, T_bim_map=None, matches=matches, metrics=metrics, deviations=[])


class Page(HTMLParser):
    """Counts a page's elements by tag, and the children of the plan's layers; keeps its visible text, its script and
    style, and the texts of its elements with an id.
    """

    VOID = frozenset({"meta", "input", "br"})

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: Counter[str] = Counter()
        self.layers: Counter[tuple[str, str]] = Counter()
        self.attributes: list[tuple[str, str]] = []
        self.text = ""
        self.inside: dict[str, str] = {}  # by id, else by tag
        self.open: list[tuple[str, str]] = []
        self.feed(html)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = {k: v or "" for k, v in attrs}
        self.tags[tag] += 1
        self.attributes += values.items()
        if any(kind == "plan" for _, kind in self.open):
            layer = next((kind for _, kind in reversed(self.open) if kind.startswith("layer-")), "")
            self.layers[layer, tag] += 1
        if tag not in self.VOID:
            self.open.append((tag, values.get("id") or values.get("class", "")))

    def handle_endtag(self, tag: str) -> None:
        assert self.open and self.open.pop()[0] == tag, f"</{tag}> closes nothing"

    def handle_data(self, text: str) -> None:
        if self.open:
            name = self.open[-1][1] or self.open[-1][0]
            self.inside[name] = self.inside.get(name, "") + text
            if self.open[-1][0] not in ("script", "style"):
                self.text += text + "\n"
