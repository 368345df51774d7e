"""A run to report on, what could have become of it, verdicts on elements, and a reader of the page."""

from collections import Counter
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np

from data.scene_graph import Floor
from data.trajectory import Trajectory
from sgslam.as_built.elements import ElementVerdict, Verdict
from sgslam.report import ReportData, RunFolder
from sgslam.report.elements import shown_as_element
from sgslam.session.soundness.scan_uncertainty import ScanUncertainty

LOST, APART = slice(100, 130), slice(190, 220)  # of the scans of `with_lost_scans`


def reported(run: Path) -> ReportData:
    """Of the folder of `anchored_run`, with the truth and an anchor for each match."""
    data = report_data(RunFolder.read(run / "out"))
    anchors = [anchor(wall, a_id) for wall, (a_id, _) in data.pairs("wall_surfaces").items()]
    return replace(data, truth=Trajectory.read_tum(run / "truth.tum"), anchors=anchors)


def report_data(run: RunFolder) -> ReportData:
    """A finished run, without ground truth and without the log of its anchors."""
    in_map, odometry = (Trajectory.read_tum(run.path / f"trajectory_{name}.tum") for name in ("map", "odometry"))
    table = np.genfromtxt(run.path / "trajectory_sigma.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    sigma = np.full((len(table), 6), np.nan)
    sigma[:, 0], sigma[:, 1] = table["sigma_x_m"], table["sigma_y_m"]
    stamps, none = in_map.stamps_ns, np.full(len(table), "")
    return ReportData(
        run.a_graph, run.s_graph, in_map, odometry, None, run.T_bim_map, run.matches, run.metrics, run.deviations,
        ScanUncertainty(stamps, sigma, table["part"], none, table["probability"], table["anchored"], table["health"]),
        elements=[*run.elements, *map(shown_as_element, run.unplanned)], tolerance=run.config.as_built.tolerance,
    )  # fmt: skip


def anchor(wall: str, a_id: str, withdrawn: str | None = None) -> dict[str, Any]:
    """An anchor of a wall; `withdrawn` is why it holds no more."""
    events = [{"stamp_ns": 7_800_000_000, "state": "tight", "why": "as planned within 25 mm"}]
    if withdrawn is not None:
        events.append({"stamp_ns": 30_000_000_000, "state": "withdrawn", "why": withdrawn})
    return {"wall": wall, "a_id": a_id, "by": "match 1", "state": events[-1]["state"], "events": events}


def with_lost_scans(data: ReportData) -> ReportData:
    """Some scans are lost; some lie in a part that was not placed, which is laid far away."""
    assert data.scans is not None
    health, part, poses = data.scans.health.copy(), data.scans.part.copy(), data.trajectory_map.poses.copy()
    health[LOST], part[APART] = "lost", 1
    poses[APART, 0, 3] -= 500.0
    scans = replace(data.scans, health=health, part=part)
    return replace(data, scans=scans, trajectory_map=Trajectory(data.trajectory_map.stamps_ns, poses))


def on_two_floors(data: ReportData, placed: bool) -> ReportData:
    """After 20 of its keyframes the robot is on none of the floors, after 30 on the upper one, `placed` or not."""
    assert data.a_graph is not None
    (ground,), on = data.a_graph.floors, ["floor-0"] * 20 + [None] * 10 + ["floor-1"] * 99
    keyframes = tuple(replace(k, floor=own) for k, own in zip(data.s_graph.keyframes, on, strict=False))
    floors = (*data.s_graph.floors, Floor("floor-1", "", 2.2))
    found = {"floor-0": ground.id} | ({"floor-1": "upper"} if placed else {})
    return replace(
        data,
        a_graph=replace(data.a_graph, floors=(ground, Floor("upper", "Upper", 46.0))),
        s_graph=replace(data.s_graph, keyframes=keyframes, floors=floors),
        matches={**(data.matches or {}), "floors": found},
    )


def not_anchored(data: ReportData, status: str) -> ReportData:
    """The same run, of which the matcher says `ambiguous`, of two places, or `none`."""
    (best, *_) = data.hypotheses
    matches = dict(data.matches or {}, status=status, hypotheses=[best, best | {"score": best["score"] - 0.6}])
    if status == "none":
        matches |= {"rooms": [], "wall_surfaces": [], "T_a_s": None, "floor": None, "hypotheses": []}
    metrics = data.metrics | {"anchored": False, "reason": "two places fit alike", "T_bim_map": None}
    return replace(data, T_bim_map=None, matches=matches, metrics=metrics, deviations=[], elements=[])


def without_plan(data: ReportData) -> ReportData:
    """The same run, to which no plan was given."""
    data = not_anchored(data, "none")
    metrics = data.metrics | {"reason": "no plan was given", "accuracy": {"rmse_bim_m": None}}
    return replace(data, a_graph=None, matches=None, truth=None, metrics=metrics)


def verdict(global_id: str, told: Verdict, offset: float | None = None, **more: Any) -> ElementVerdict:
    """On a wall of 2 m, measured with a sigma of 5 mm where it has an offset."""
    fields = dict.fromkeys(("direction", "sigma_m", "loa", "turn_rad", "turn_sigma_rad"))
    fields |= dict.fromkeys(("din_18202_limit_m", "din_18202"))
    if offset is not None:
        fields |= {"direction": (0.0, 1.0, 0.0), "sigma_m": 0.005, "loa": "LOA30"}
    fields |= {"offset_m": offset, "ifc_class": "IfcWall", "storey": "Ground", "rooms": ("Hall",), "verdict": told}
    fields |= {"conclusive": told != "uncertain", "seen": 0.85, "views": 7, "reason": "because", "coverage": 0.4}
    fields |= {"progress": "installed" if offset is not None else "not enough data", "tolerance": None}
    fields["outline"] = ((0.0, 0.0), (2.0, 0.0), (2.0, 0.2), (0.0, 0.2))
    return ElementVerdict(global_id, f"Wall {global_id}", **(fields | more))


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
