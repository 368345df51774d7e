"""A run to report on: a building of two storeys, its map, a drive through it, verdicts; and a reader of the page."""

from collections import Counter
from dataclasses import asdict, replace
from html.parser import HTMLParser
from typing import Any

import numpy as np
from boxes import pose
from plans import a_graph, merged, moved, offices

from data.geometry.poses import poses_to_xyzquat
from data.scene_graph import Floor, Keyframe, SceneGraph, WallSurface
from data.trajectory import Trajectory
from sgslam.as_built.elements import ElementVerdict, Verdict
from sgslam.report import ReportData
from sgslam.report.scan_states import ScanStates

HOSTILE = "<script>alert('x')</script> & \"Söhne\" $\\frac$"
T_BIM_MAP = pose(12.0, 3.0, 4.0, 0.6)


def building(rooms_a_side: int = 4) -> SceneGraph:
    """Two storeys, 3.5 m apart: a corridor along x with rooms of several widths on both its sides."""
    widths = [3.0 + i * 7 % 4 for i in range(rooms_a_side)]
    floors = tuple(Floor(f"F{k}", f"Storey {k}", 3.5 * k) for k in range(2))
    plan = merged(*(a_graph(offices(widths, widths), floor.id, f"{floor.id} ") for floor in floors))
    rooms = tuple(replace(room, name=f"Office {room.id}") for room in plan.rooms)
    walls = tuple(replace(wall, source=f"guid {wall.id}") for wall in plan.wall_surfaces)
    return replace(plan, rooms=rooms, wall_surfaces=walls, floors=floors)


def mapped(plan: SceneGraph, storey: str = "F1", floor: str | None = None) -> SceneGraph:
    """A storey as a robot maps it, with ids of its own; and one cupboard that no plan knows."""
    x, y, _ = np.linalg.inv(T_BIM_MAP)[:3, 3]
    seen = moved(plan.on_floor(storey), -0.6, x, y)
    rooms = tuple(replace(r, id=f"S{r.id}", name=f"room {k}", floor=floor) for k, r in enumerate(seen.rooms))
    walls = [
        replace(w, id=f"S{w.id}", room=f"S{w.room}", floor=floor, source="", height=(0.1, 1.6))
        for w in seen.wall_surfaces
    ]
    cupboard = WallSurface("Scupboard", None, tuple((np.linalg.inv(T_BIM_MAP) @ [6, 2, 4, 1])[:2]), (1.0, 0.0), None)
    return SceneGraph("map", rooms, (*walls, cupboard), floors=(Floor("floor-0", "", -0.5),))


def drive(count: int) -> Trajectory:
    """In the BIM frame, 0.5 m above the floor at 3.5 m: along the corridor and into a room."""
    s = np.linspace(0, 1, count)
    poses = np.tile(np.eye(4), (count, 1, 1))
    y = 6.1 + 0.3 * np.sin(20 * s) + 3.5 * np.clip((s - 0.8) / 0.2, 0, 1)
    poses[:, :3, 3] = np.column_stack([1 + 14 * s, y, np.full(count, 4.0)])
    return Trajectory(np.arange(count) * 100_000_000, poses)


def sample(count: int = 500, rooms_a_side: int = 4) -> ReportData:
    """An anchored run: every surface of the storey matched, two walls moved, one absent; the odometry, in its own
    frame, turns away."""
    plan, truth = building(rooms_a_side), drive(count)
    trajectory = truth.transformed(np.linalg.inv(T_BIM_MAP))
    poses = poses_to_xyzquat(trajectory.poses[::10]).tolist()
    s_graph = mapped(plan)
    s_graph = replace(s_graph, keyframes=tuple(Keyframe(f"k{i}", i, tuple(own)) for i, own in enumerate(poses)))
    place = [0.6, 12.0, 3.0]
    hypotheses = [
        {"score": 31.5, "T_a_s": place, "floor": "F1", "rooms": [["SF1 room8", "F1 room8"]]},
        {"score": 30.9, "T_a_s": [3.74, 5.0, -3.0], "floor": "F0", "rooms": []},
    ]
    matches = {"status": "unique", "reason": "one place", "floor": "F1", "T_a_s": place, "hypotheses": hypotheses}
    judged = {"rmse_bim_m": 0.0123, "max_bim_m": 0.041, "yaw_rmse_bim_deg": 0.11, "rmse_odometry_aligned_m": 0.084}
    metrics = {
        "anchored": True,
        "reason": "anchored to Storey 1",
        "T_bim_map": poses_to_xyzquat(T_BIM_MAP).tolist(),
        "scans": count,
        "scans_skipped": 1,
        "keyframes": 61,
        "rooms": len(s_graph.rooms),
        "wall_surfaces": len(s_graph.wall_surfaces),
        "first_anchor_s": 14.2,
        "seconds": {"total": 9.31, "odometry": 5.2},
        "accuracy": judged | {"matched_poses": count, "total_poses": count},
        "about": {"Building": "block.ifc", "Tolerance": "30 mm", "Version": "sgslam 1.2.3"},
    }
    turns = [pose(0, 0, 0, 2 * turn) for turn in np.linspace(0, 0.05, count)]
    odometry = Trajectory(trajectory.stamps_ns, turns @ np.linalg.inv(trajectory.poses[0]) @ trajectory.poses)
    states = ScanStates(
        np.arange(count) / 10, np.zeros(count, bool), np.zeros(count, np.int64), np.full((count, 2), 0.004)
    )
    data = ReportData(
        plan, s_graph, trajectory, odometry, truth, T_BIM_MAP, matches, metrics, deviations(s_graph), states
    )
    return replace(with_matches(data), elements=entries(plan))


def with_matches(data: ReportData, floors: frozenset[str | None] = frozenset({None})) -> ReportData:
    """Each room and wall of these floors of the map is matched to the planned one, and anchored."""
    pairs = {
        kind: [[own.id, own.id[1:], 0.97] for own in items if own.floor in floors and own.id != "Scupboard"]
        for kind, items in (("rooms", data.s_graph.rooms), ("wall_surfaces", data.s_graph.wall_surfaces))
    }
    anchors = [anchor(s_id, a_id) for s_id, a_id, _ in pairs["wall_surfaces"]]
    return replace(data, matches={**(data.matches or {}), **pairs}, anchors=anchors)


def anchor(wall: str, a_id: str, withdrawn: str | None = None) -> dict[str, Any]:
    """An anchor of a wall; `withdrawn` is why it holds no more."""
    events = [{"stamp_ns": 14_200_000_000, "state": "tight", "why": "as planned within 25 mm"}]
    if withdrawn is not None:
        events.append({"stamp_ns": 30_000_000_000, "state": "withdrawn", "why": withdrawn})
    return {"wall": wall, "a_id": a_id, "by": "match 1", "state": events[-1]["state"], "events": events}


def with_lost_scans(data: ReportData) -> ReportData:
    """Scans 100 to 129 are lost; 400 to 449 lie in a part that was not placed, which is laid far away."""
    assert data.scans is not None
    lost, part, poses = data.scans.lost.copy(), data.scans.part.copy(), data.trajectory_map.poses.copy()
    lost[100:130], part[400:450] = True, 1
    poses[400:450, 0, 3] -= 500.0
    scans = replace(data.scans, lost=lost, part=part)
    return replace(data, scans=scans, trajectory_map=Trajectory(data.trajectory_map.stamps_ns, poses))


def on_two_floors(placed: bool) -> ReportData:
    """First on the lower storey, then on the upper one, `placed` in the plan or not; between them, on none."""
    data = sample()
    assert data.a_graph is not None
    lower, upper = (mapped(data.a_graph, f"F{k}", f"floor-{k}") for k in range(2))
    on = ["floor-0"] * 20 + [None] * 10 + ["floor-1"] * 20
    keyframes = tuple(replace(k, stamp_ns=10**9 * i, floor=on[i]) for i, k in enumerate(data.s_graph.keyframes))
    walls = (*lower.wall_surfaces[:-1], *upper.wall_surfaces[:-1])
    floors = (Floor("floor-0", "", -4.0), Floor("floor-1", "", -0.5))
    s_graph = SceneGraph("map", (*lower.rooms, *upper.rooms), walls, (), floors, keyframes)
    found = {"floor-0": "F0"} | ({"floor-1": "F1"} if placed else {})
    matches = {**(data.matches or {}), "floor": "F0", "floors": found}
    return with_matches(replace(data, s_graph=s_graph, matches=matches, deviations=[]), frozenset(found))


def not_anchored(status: str) -> ReportData:
    """The same run, of which the matcher says `ambiguous` or `none`."""
    data = sample()
    matches = dict(data.matches or {}, status=status)
    if status == "none":
        matches |= {"rooms": [], "wall_surfaces": [], "T_a_s": None, "floor": None, "hypotheses": []}
    metrics = data.metrics | {"anchored": False, "reason": "two places fit alike", "T_bim_map": None}
    return replace(data, T_bim_map=None, matches=matches, metrics=metrics, deviations=[], elements=[])


def without_plan() -> ReportData:
    """The same run, to which no plan was given."""
    data = not_anchored("none")
    judged = {"rmse_bim_m": None, "rmse_map_aligned_m": 0.0051, "rmse_odometry_aligned_m": 0.0046}
    metrics = data.metrics | {"reason": "no plan was given", "accuracy": judged}
    return replace(data, a_graph=None, matches=None, truth=None, metrics=metrics)


def deviations(s_graph: SceneGraph) -> list[dict[str, Any]]:
    """Walls within 2 mm but for two, one that is not there, and a cupboard."""
    nothing = {"offset_m": None, "tilt_rad": None, "sigma_m": None, "significant": True}
    found: list[dict[str, Any]] = []
    for i, wall in enumerate(s_graph.wall_surfaces[:-1]):
        offset = {5: -0.1234, 7: 0.045}.get(i, 0.001 * (i % 5 - 2))
        measured = {"offset_m": offset, "tilt_rad": 0.01, "sigma_m": 0.01, "significant": abs(offset) > 0.03}
        found.append({"s_id": wall.id, "a_id": wall.id[1:], "source": f"guid-{i}", "kind": "moved"} | measured)
    extra = {"s_id": "Scupboard", "a_id": None, "source": None, "kind": "extra"} | nothing
    absent = {"s_id": None, "a_id": "F1 room0/0", "source": "guid-absent", "kind": "absent"} | nothing
    return [*found, extra, absent]


def verdict(
    global_id: str, name: str, told: Verdict, wall: WallSurface, offset: float | None = None, **more: Any
) -> ElementVerdict:
    """Of a wall 20 cm deep behind a planned surface, measured with a sigma of 5 mm where it has an offset."""
    normal, half = np.array(wall.normal), (wall.length or 1.0) / 2
    along, start = np.array([-normal[1], normal[0]]), np.array(wall.centroid)
    corners = [start + s * half * along - d * normal for s, d in ((-1, 0), (1, 0), (1, 0.2), (-1, 0.2))]
    known = {
        "offset_m": offset,
        "direction": (0.0, 1.0, 0.0),
        "sigma_m": 0.005,
        "loa": "LOA30",
        "turn_rad": 0.0005,
        "turn_sigma_rad": 0.0008,
        "din_18202_limit_m": 0.012,
        "din_18202": "kept",
    }
    fields = {
        "ifc_class": "IfcWallStandardCase",
        "storey": "Storey 1",
        "rooms": ("Corridor",),
        "verdict": told,
        "conclusive": told != "uncertain",
        "seen": 0.0 if told == "not seen" else 0.85,
        "views": 7,
        "reason": f"because it is {told}",
        "outline": tuple((float(x), float(y)) for x, y in corners),
    } | (known if offset is not None else dict.fromkeys(known))
    return ElementVerdict(global_id, name, **(fields | more))


def entries(plan: SceneGraph) -> list[dict[str, Any]]:
    """Eight elements of the upper storey that were seen and one that was not, as elements.json has them."""
    walls = [w for w in plan.wall_surfaces if w.floor == "F1"]
    found = [verdict(f"{k:022d}", f"Wall {k}", "as planned", walls[k], 0.001 * k) for k in range(4)]
    found += [
        verdict("guid-absent", "Wall 12", "absent", walls[4]),
        verdict("1moved000000000000Wall", "Wall 30", "moved", walls[5], -0.1234, din_18202="exceeded"),
        verdict("2nameless00000000000Wa", " ", "moved", walls[6], 0.045),
        verdict("3door0000000000000Door", "Door 7", "uncertain", walls[7], ifc_class="IfcDoor"),
        verdict("4hidden000000000000000", "Wall 41", "not seen", walls[8]),
    ]
    return [asdict(own) for own in found]


class Page(HTMLParser):
    """A page whose elements are closed in order: how many of each tag, its visible text, and the text by id."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: Counter[str] = Counter()
        self.text = ""
        self.inside: dict[str, str] = {}  # by id, else by tag
        self._open: list[tuple[str, str]] = []
        self.feed(html)
        self.close()
        assert not self._open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags[tag] += 1
        if tag not in ("meta", "input", "br"):
            self._open.append((tag, dict(attrs).get("id") or tag))

    def handle_endtag(self, tag: str) -> None:
        assert self._open and self._open.pop()[0] == tag, f"</{tag}> closes nothing"

    def handle_data(self, text: str) -> None:
        if self._open:
            tag, name = self._open[-1]
            self.inside[name] = self.inside.get(name, "") + text
            self.text += text + "\n" if tag not in ("script", "style") else ""
