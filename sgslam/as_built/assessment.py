"""What a run says of its building: each planned element, and what no plan shows, by one comparison of rays."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypedDict, cast

import numpy as np
from numpy.typing import NDArray

from data.plans.bodies import PlannedElement, wall_ids
from data.scene_graph import SceneGraph, WallSurface, Xy
from sgslam.as_built.elements import ElementVerdict, element_findings
from sgslam.as_built.elements.entries import PlannedRooms, entry
from sgslam.as_built.elements.likelihoods import Limits
from sgslam.as_built.elements.rays import SeenRays, Sightings, View, sightings
from sgslam.as_built.elements.tolerance_classes import is_off
from sgslam.as_built.elements.verdicts import offset_along
from sgslam.as_built.unplanned.entries import UnplannedEntry, storeys_of, unplanned_things
from sgslam.as_built.unplanned.stretches import unexplained
from sgslam.geometry.frames import transform_points

Floats = NDArray[np.float64]
_ACROSS = 0.7  # cosine of the angle between a wall's direction of offsets and a surface, below which it is its end


class Deviation(TypedDict):
    """A wall surface that differs from the plan, or that was checked against it.

    `s_id` is a surface of the S-graph, `a_id` one of the A-graph, `source` the id of the planned wall in its file. The
    mapped surface of a planned one is `moved`, whether or not it is: `offset_m` is its wall's distance there from the
    planned place, along the plan's inward normal, with standard deviation `sigma_m`, and `tilt_rad` the wall's turn
    about the vertical, 0 where it was not measured. A planned surface is `absent` where the scans see through its
    wall's place. A mapped surface is `extra` where the plan has no wall: `trace` are the ends in plan view of the whole
    wall (BIM frame, metres). `significant`: the wall is off by more than the tolerance and the measurement error.
    `reason` explains it.
    """

    s_id: str | None
    a_id: str | None
    source: str
    kind: Literal["moved", "absent", "extra"]
    trace: tuple[Xy, Xy] | None
    offset_m: float | None
    tilt_rad: float | None
    sigma_m: float | None
    significant: bool
    reason: str


@dataclass(frozen=True)
class Assessment:
    """The verdicts on the planned `elements` in their order, what is `unplanned`, and both as `deviations`."""

    elements: tuple[ElementVerdict, ...] = ()
    unplanned: tuple[UnplannedEntry, ...] = ()
    deviations: tuple[Deviation, ...] = ()


@dataclass(frozen=True, eq=False)
class AnchoredMap:
    """A finished map in its plan: both graphs, T_bim_map (4, 4), `matches` as in matches.json, and the keyframes'
    `views`."""

    s_graph: SceneGraph
    plan: SceneGraph
    T_bim_map: Floats
    matches: Mapping[str, Any] | None
    views: Sequence[View]


def assess(
    run: AnchoredMap, elements: Sequence[PlannedElement], others: Floats, tolerance: float, shared: float
) -> Assessment:
    """Compares what the keyframes saw with the elements of the plan.

    `others` (M, 3, 3) are the bodies of what else is planned, such as stairs and furniture. `tolerance` (m) is the
    largest offset that counts as planned, `shared` (m) the standard deviation of the error that all sightings of an
    element share.
    """
    solids = [element for element in elements if element.kind == "solid"]
    rays = SeenRays(run.views, solids)
    seen = sightings(rays)
    found = element_findings(elements, rays, seen, Limits(tolerance, shared))
    rooms = PlannedRooms.of(run.plan)
    verdicts = tuple(entry(element, own, rooms) for element, own in zip(elements, found, strict=True))
    openings = [part for element in elements if element.kind == "opening" for part in _parts(element)]
    judged = [
        (own, verdict)
        for element, own, verdict in zip(elements, found, verdicts, strict=True)
        if element.kind == "solid"
    ]
    cells = unexplained(rays, solids, [own for own, _ in judged], np.concatenate([others, *openings]))
    unplanned = tuple(
        unplanned_things(cells, rays, run.s_graph, run.T_bim_map, storeys_of(run.matches, run.s_graph), run.plan)
    )
    walls = {verdict.global_id: (number, verdict) for number, (_, verdict) in enumerate(judged)}
    return Assessment(verdicts, unplanned, tuple(_deviations(run, walls, seen, unplanned)))


def _parts(opening: PlannedElement) -> list[Floats]:
    """The bodies of an opening and of what fills it."""
    return [opening.triangles] if opening.filling is None else [opening.triangles, opening.filling]


def _deviations(
    run: AnchoredMap, walls: Mapping[str, tuple[int, ElementVerdict]], seen: Sightings, found: Sequence[UnplannedEntry]
) -> Iterator[Deviation]:
    """The deviations of wall surfaces; `walls` are the numbers of solids in `seen`, and the verdicts on them, by their
    ids, `found` is what no plan shows."""
    mapped = dict[str, list[str]]()
    for s_id, a_id, *_ in (run.matches or {}).get("wall_surfaces") or []:
        mapped.setdefault(a_id, []).append(s_id)
    for surface in run.plan.wall_surfaces:
        for wall in wall_ids(surface):
            if wall in walls:
                yield from _of_surface(run, surface, mapped.get(surface.id, []), seen, *walls[wall])
    for thing in found:
        for s_id in thing.surfaces if thing.kind == "wall-like" else ():
            yield _deviation("extra", thing.reason, s_id=s_id, trace=thing.trace)


def _of_surface(
    run: AnchoredMap, surface: WallSurface, mapped: Sequence[str], seen: Sightings, wall: int, verdict: ElementVerdict
) -> Iterator[Deviation]:
    """The entries of one surface of a wall with this number and verdict, one for each `mapped` surface there."""
    of_surface = {"a_id": surface.id, "source": verdict.global_id}
    if verdict.verdict == "absent":
        yield _deviation("absent", verdict.reason, **of_surface)
        return
    normal = np.array(surface.normal)
    cosine = 0.0 if verdict.direction is None else float(np.dot(verdict.direction[:2], normal))
    if verdict.offset_m is None or abs(cosine) < _ACROSS:
        return
    sigma = verdict.sigma_m or 0.0
    of_wall = {"tilt_rad": verdict.turn_rad or 0.0, "sigma_m": sigma}
    of_wall["significant"] = is_off(verdict.verdict, verdict.offset_m, sigma)
    for s_id in mapped:
        ends = np.array([(*end, 0.0) for end in run.s_graph.surface_by_id[s_id].ends()])
        along = transform_points(run.T_bim_map, ends)[:, :2] @ [-normal[1], normal[0]]
        here = offset_along(seen, wall, normal, (float(along.min()), float(along.max())))
        # the wall as a whole need not be straight; where too little of a stretch was seen, it is taken to be
        off = verdict.offset_m * float(np.sign(cosine)) if here is None else here
        reason = f"{1000 * off:+.0f} mm here; its wall: {verdict.reason}"
        yield _deviation("moved", reason, **of_surface, **of_wall, s_id=s_id, offset_m=off)


def _deviation(kind: str, reason: str, **known: Any) -> Deviation:
    """An entry with these fields; the others are null."""
    entry = dict.fromkeys(Deviation.__annotations__) | {"source": "", "significant": True, "kind": kind}
    return cast(Deviation, entry | {"reason": reason} | known)
