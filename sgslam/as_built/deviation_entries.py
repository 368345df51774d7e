"""The entries of deviations.json: the verdicts on elements and what is unplanned, by the surfaces of both graphs."""

from collections.abc import Iterator, Sequence
from typing import Literal, TypedDict

import numpy as np

from data.plans.bodies import wall_ids
from data.scene_graph import SceneGraph, WallSurface, Xy
from sgslam.as_built.elements import ElementVerdict
from sgslam.as_built.unplanned.entries import UnplannedEntry


class Deviation(TypedDict):
    """A wall surface that differs from the plan, or that was checked against it.

    `s_id` is a surface of the S-graph, `a_id` one of the A-graph, `source` the id of the planned wall in its file. The
    mapped surface of a planned one is `moved`, whether or not it is: `offset_m` is the distance of its wall from the
    planned place, along the plan's inward normal, with standard deviation `sigma_m`, and `tilt_rad` the wall's turn
    about the vertical, 0 where it was not measured. A planned surface is `absent` where the scans see through its
    wall's place. A mapped surface is `extra` where the plan has no wall: `trace` are the ends in plan view of the whole
    wall (BIM frame, metres). `significant`: the difference is larger than the tolerance. `reason` explains it.
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


def deviations_of(
    verdicts: Sequence[ElementVerdict], unplanned: Sequence[UnplannedEntry], plan: SceneGraph,
    pairs: Sequence[Sequence[str | float]],
) -> list[Deviation]:  # fmt: skip
    """The deviations of wall surfaces; `pairs` as `wall_surfaces` in matches.json."""
    by_id = {verdict.global_id: verdict for verdict in verdicts}
    mapped: dict[str, list[str]] = {}
    for s_id, a_id, *_ in pairs:
        mapped.setdefault(str(a_id), []).append(str(s_id))
    found = [
        deviation for surface in plan.wall_surfaces for wall in wall_ids(surface) if wall in by_id
        for deviation in _of_surface(by_id[wall], surface, mapped.get(surface.id, []))
    ]  # fmt: skip
    return found + [_extra(own, s_id) for own in unplanned if own.kind == "wall-like" for s_id in own.surfaces]


def _of_surface(verdict: ElementVerdict, surface: WallSurface, mapped: Sequence[str]) -> Iterator[Deviation]:
    """The entries of one surface of a wall with this verdict, one for each mapped surface that was matched to it."""
    own: Deviation = {
        "s_id": None, "a_id": surface.id, "source": verdict.global_id, "kind": "absent", "trace": None,
        "offset_m": None, "tilt_rad": None, "sigma_m": None, "significant": True, "reason": verdict.reason,
    }  # fmt: skip
    if verdict.verdict == "absent":
        yield own
    elif verdict.offset_m is not None and verdict.direction is not None:
        cosine = float(np.dot(verdict.direction[:2], surface.normal))
        if abs(cosine) > np.cos(np.radians(45.0)):
            for s_id in mapped:
                yield {
                    **own, "s_id": s_id, "kind": "moved", "offset_m": verdict.offset_m * float(np.sign(cosine)),
                    "tilt_rad": verdict.turn_rad or 0.0, "sigma_m": verdict.sigma_m,
                    "significant": verdict.verdict == "moved",
                }  # fmt: skip


def _extra(own: UnplannedEntry, s_id: str) -> Deviation:
    return {
        "s_id": s_id, "a_id": None, "source": "", "kind": "extra", "trace": own.trace, "offset_m": None,
        "tilt_rad": None, "sigma_m": None, "significant": True, "reason": own.reason,
    }  # fmt: skip
