"""What a run says of the elements of a building that is not as planned, beside how they were built."""

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
import shapely
from pydantic import BaseModel, ConfigDict

from data.ifc.products import open_ifc
from data.scene_graph import SceneGraph, Xy
from data.simulation import Change
from data.simulation.as_built import fillings
from evaluation.buildings import plan_graph
from evaluation.conditions import BUILDING
from evaluation.drive import Drive, DriveCase
from evaluation.metrics.true_walls import TrueWall, true_walls
from evaluation.study import Record
from sgslam.as_built.elements import ElementVerdict, Verdict
from sgslam.result import Result

Element = Literal["wall", "door", "window", "column"]
State = Literal["as planned", "moved", "displaced", "filled", "absent"]
CLASSES: dict[str, Element] = {"IfcWall": "wall", "IfcDoor": "door", "IfcWindow": "window", "IfcColumn": "column"}
STANDARD_CASE = "StandardCase"  # at the end of some names of classes
LEAST_VIEWS = 3  # keyframes that must see a wall to be found
ON_WALL_M = 0.2  # between an unplanned wall and an entry that means it
ENOUGH_M = 1.0  # of an entry on a wall that suffice, or else half of the entry


class Judged(BaseModel):
    """An element and its verdict. It was `built` off its planned place by `true_m` along the direction of `offset_m`
    (m); of a wall without a measured direction, across. `views` keyframes see a wall or, if it is absent, through it;
    None for other elements."""

    model_config = ConfigDict(frozen=True)

    element: Element
    built: State
    true_m: float
    verdict: Verdict
    offset_m: float | None
    sigma_m: float | None
    conclusive: bool
    seen: float
    views: int | None


def verdicts_of(case: DriveCase, drive: Drive, result: Result, ifc: Path) -> Record:
    """`judged`: walls, doors, windows and columns with their verdicts, but of those that stand as planned only the ones
    that were seen; `not_seen`: how many of the others, by how they were built. `unplanned`: walls that stand and are
    not planned, of which `to_find` are seen by three keyframes; `false` entries are on no such wall and on no planned
    one, `on_planned` on planned ones alone. `visited_m2` is the area of the route's rooms. `ifc` is the
    building."""
    found = replace(result, plan_file=drive.plan).assessment
    # seen from where the keyframes with a cloud were in truth
    stamps = [k.stamp_ns for k in result.s_graph.keyframes if len(result.clouds[int(k.id[1:])])]
    at = np.searchsorted(drive.truth.stamps_ns, stamps).tolist()
    walls = true_walls(ifc, drive.storey, BUILDING[case.changes], case.seed, drive.truth, at)
    stands_off = {change.id: change for change in drive.stands_off}
    building = _Building(_with_fillings(ifc, drive.changes), stands_off, {wall.id: wall.views for wall in walls})
    judged = [entry for entry in map(building.judged, found.elements) if entry is not None]
    seen = [entry for entry in judged if (entry.built, entry.verdict) != ("as planned", "not seen")]
    return {
        "judged": [entry.model_dump() for entry in seen],
        "not_seen": dict(Counter(entry.built for entry in judged if entry.verdict == "not seen")),
        "visited_m2": _area(plan_graph(drive.plan), {room for room, _ in drive.rooms}),
        "unplanned": _unplanned([own.trace for own in found.unplanned if own.kind == "wall-like"], walls),
    }


@dataclass(frozen=True)
class _Building:
    """How a building differs from its plan, by GlobalId; `stands_off` is how far each wall is off its place besides,
    `views` from how many keyframes it is seen."""

    changes: Mapping[str, Change]
    stands_off: Mapping[str, Change]
    views: Mapping[str, int]

    def judged(self, entry: ElementVerdict) -> Judged | None:
        """The entry beside the truth; None for an element of another class."""
        element = CLASSES.get(entry.ifc_class.removesuffix(STANDARD_CASE))
        if element is None:
            return None
        return Judged(
            element=element,
            built=self._state(entry.global_id),
            true_m=self._offset(entry),
            verdict=entry.verdict,
            offset_m=entry.offset_m,
            sigma_m=entry.sigma_m,
            conclusive=entry.conclusive,
            seen=entry.seen,
            views=self.views.get(entry.global_id, 0) if element == "wall" else None,
        )

    def _state(self, element: str) -> State:
        change = self.changes.get(element)
        if change is None:
            return "as planned"
        if change.kind == "unplanned":
            raise ValueError(f"{element} is not planned, and has a verdict")
        return change.kind

    def _offset(self, entry: ElementVerdict) -> float:
        shifts = (of.get(entry.global_id) for of in (self.changes, self.stands_off))
        offset = np.sum([(0.0, 0.0), *(shift.offset_in_bim for shift in shifts if shift is not None)], axis=0)
        return float(np.linalg.norm(offset) if entry.direction is None else offset @ entry.direction[:2])


def _area(plan: SceneGraph, rooms: Collection[str]) -> float:
    """m2, of rooms of a plan (ids)."""
    return float(sum(shapely.Polygon(r.polygon).area for r in plan.rooms if r.id in rooms and r.polygon))


def _with_fillings(ifc: Path, changes: Iterable[Change]) -> dict[str, Change]:
    """The changes by GlobalId; doors and windows in absent walls are absent too."""
    found = {change.id: change for change in changes}
    if absent := [change.id for change in found.values() if change.kind == "absent"]:
        model = open_ifc(ifc)
        walls = [wall for wall in map(model.by_guid, absent) if wall.is_a("IfcWall")]
        found.update({key: Change(key, "absent") for wall in walls for key in fillings(wall)})
    return found


def _unplanned(traces: Sequence[tuple[Xy, Xy]], walls: Sequence[TrueWall]) -> Record:
    """The score of the entries with these ends (x, y, BIM frame), given the storey's walls."""
    kinds = {wall.id: wall.kind for wall in walls}
    lies_on = [{wall.id for wall in walls if _is_on(trace, wall)} for trace in traces]
    meant = [{key for key in on if kinds[key] == "unplanned"} for on in lies_on]
    to_find = {wall.id for wall in walls if wall.kind == "unplanned" and wall.views >= LEAST_VIEWS}
    return {
        "to_find": len(to_find),
        "found": len(to_find & {key for on in meant for key in on}),
        "false": sum(not on for on in lies_on),
        "on_planned": sum(bool(on) and not of for on, of in zip(lies_on, meant, strict=True)),
    }


def _is_on(trace: tuple[Xy, Xy], wall: TrueWall) -> bool:
    line = shapely.LineString(trace)
    on = shapely.Polygon(wall.footprint).buffer(ON_WALL_M).intersection(line).length
    return bool(on >= min(line.length / 2, ENOUGH_M))
