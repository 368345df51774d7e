"""The entries of elements.json: what was found of an element, in the tolerance classes of the trade."""

from dataclasses import dataclass

import numpy as np
import shapely

from data.plans.bodies import PlannedElement
from data.scene_graph import Room, SceneGraph, Xy
from sgslam.as_built.elements.likelihoods import Finding, Progress, Verdict
from sgslam.as_built.elements.tolerance_classes import Compliance, angle_limit, compliance, loa_class
from sgslam.config.sensor import BUILDING


@dataclass(frozen=True)
class ElementVerdict:
    """One entry of elements.json.

    `offset_m` is along `direction` (x, y, z), a unit vector in the BIM frame, with standard deviation `sigma_m`; all
    None where nothing was measured. `progress` is whether it is there, `tolerance` whether the offset is within the
    tolerance, by two sigma; `doubt`: if it is not, what was measured may be something else. `conclusive` is whether the
    element is absent, or `tolerance` decided; `loa` the USIBD level of accuracy of the measurement. `turn_rad` is a
    wall's turn about the vertical, counter-clockwise from above, `turn_sigma_rad` its standard deviation,
    `din_18202_limit_m` the limit of DIN 18202 for the deviation that the turn makes over the wall's length, `din_18202`
    whether it is kept; None for other elements. `seen` is the share of the cells of its visible surface at which it
    stands or that are seen through, `coverage` that of the whole face, of the better seen one of its sides; `views` the
    number of keyframes. `outline` are the corners of the rectangle around it in plan view (BIM frame, metres). `grid`
    names the plan's grid lines at which it stands, such as B/3; empty without any.
    """

    global_id: str
    name: str
    ifc_class: str
    storey: str
    rooms: tuple[str, ...]
    verdict: Verdict
    progress: Progress
    tolerance: Compliance | None
    offset_m: float | None
    direction: tuple[float, float, float] | None
    sigma_m: float | None
    loa: str | None
    conclusive: bool
    turn_rad: float | None
    turn_sigma_rad: float | None
    din_18202_limit_m: float | None
    din_18202: Compliance | None
    seen: float
    views: int
    reason: str
    outline: tuple[Xy, ...]
    coverage: float
    doubt: bool = False
    grid: str = ""


@dataclass(frozen=True, eq=False)
class PlannedRooms:
    """The rooms of a plan that have an outline, their `outlines` in the same order, and the ids of `floors` by id and
    by name."""

    rooms: tuple[Room, ...]
    outlines: shapely.STRtree
    floors: dict[str, str]

    @staticmethod
    def of(plan: SceneGraph) -> "PlannedRooms":
        """Those of a plan."""
        rooms = tuple(room for room in plan.rooms if room.polygon)
        floors = {name: floor.id for floor in reversed(plan.floors) for name in (floor.name, floor.id)}
        return PlannedRooms(rooms, shapely.STRtree([shapely.Polygon(room.polygon) for room in rooms]), floors)


def entry(element: PlannedElement, f: Finding, plan: PlannedRooms) -> ElementVerdict:
    """The entry of an element, with the rooms of the plan that it bounds."""
    envelope = shapely.oriented_envelope(shapely.multipoints(element.triangles.reshape(-1, 3)[:, :2]))
    turn = f.turn if element.ifc_class.startswith("IfcWall") else None
    limit, kept = None, None
    if turn is not None and f.direction is not None:
        length = _length(element, f.direction)
        limit = angle_limit(length)
        kept = compliance(turn.angle * length, turn.sigma * length, limit)
    of_element = {name: getattr(element, name) for name in ("global_id", "name", "ifc_class", "storey", "grid")}
    as_found = ("verdict", "progress", "tolerance", "direction", "views", "reason", "doubt")
    of_finding = {name: getattr(f, name) for name in as_found}
    return ElementVerdict(
        **of_element,
        **of_finding,
        rooms=_rooms(element.storey, envelope, plan),
        offset_m=f.offset,
        sigma_m=f.sigma,
        loa=None if f.sigma is None else loa_class(f.sigma),
        turn_rad=None if turn is None else turn.angle,
        turn_sigma_rad=None if turn is None else turn.sigma,
        din_18202_limit_m=limit,
        din_18202=kept,
        conclusive=f.verdict == "absent" or f.tolerance in ("within", "outside"),
        seen=round(f.seen, 3),
        coverage=round(f.coverage, 3),
        outline=_corners(envelope),
    )


def _length(element: PlannedElement, direction: tuple[float, float, float]) -> float:
    """m, of the face with this normal in plan view."""
    along = element.triangles.reshape(-1, 3)[:, :2] @ np.array([-direction[1], direction[0]])
    return float(np.ptp(along))


def _rooms(storey: str, outline: shapely.Geometry, plan: PlannedRooms) -> tuple[str, ...]:
    near = plan.outlines.query(outline, "dwithin", BUILDING.around)
    floor = plan.floors.get(storey)
    own = (plan.rooms[k] for k in sorted(near.tolist()))
    return tuple(room.name or room.id for room in own if floor in (None, room.floor))


def _corners(envelope: shapely.Geometry) -> tuple[Xy, ...]:
    """To millimetres; fewer than four for an envelope without an area."""
    places = shapely.get_coordinates(envelope)
    return tuple((round(x, 3), round(y, 3)) for x, y in (places[:-1] if len(places) > 1 else places).tolist())
