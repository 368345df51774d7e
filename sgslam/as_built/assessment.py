"""What a run says of its building: each planned element, and what no plan shows, by one comparison of rays."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.plans.bodies import PlannedElement
from data.scene_graph import SceneGraph
from sgslam.as_built.deviation_entries import Deviation, MappedPiece, deviations_of, mapped_pieces
from sgslam.as_built.elements import ElementVerdict, element_findings
from sgslam.as_built.elements.entries import PlannedRooms, entry
from sgslam.as_built.elements.likelihoods import Limits
from sgslam.as_built.elements.rays import SeenRays, View, sightings
from sgslam.as_built.elements.verdicts import offset_along
from sgslam.as_built.unplanned.entries import UnplannedEntry, storeys_of, unplanned_things
from sgslam.as_built.unplanned.stretches import unexplained

Floats = NDArray[np.float64]


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
    built = [own for element, own in zip(elements, found, strict=True) if element.kind == "solid"]
    cells = unexplained(rays, solids, built, np.concatenate([others, *openings]))
    unplanned = tuple(
        unplanned_things(cells, rays, run.s_graph, run.T_bim_map, storeys_of(run.matches, run.s_graph), run.plan)
    )
    pieces = mapped_pieces(run.s_graph, run.plan, run.T_bim_map, (run.matches or {}).get("wall_surfaces") or [])
    numbers = {element.global_id: k for k, element in enumerate(solids)}

    def offset(wall: str, piece: MappedPiece) -> float | None:
        return offset_along(seen, numbers[wall], piece.normal, piece.span)

    return Assessment(verdicts, unplanned, tuple(deviations_of(verdicts, unplanned, run.plan, pieces, offset)))


def _parts(opening: PlannedElement) -> list[Floats]:
    """The bodies of an opening and of what fills it."""
    return [opening.triangles] if opening.filling is None else [opening.triangles, opening.filling]
