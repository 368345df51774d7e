"""The entries of deviations.json: the verdicts on elements and what is unplanned, by the surfaces of both graphs."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypedDict, cast

import numpy as np
from numpy.typing import NDArray

from data.plans.bodies import wall_ids
from data.scene_graph import SceneGraph, WallSurface, Xy
from sgslam.as_built.elements import ElementVerdict
from sgslam.as_built.elements.tolerance_classes import is_off
from sgslam.as_built.unplanned.entries import UnplannedEntry
from sgslam.geometry.frames import transform_points

Floats = NDArray[np.float64]
Offset = Callable[[str, "MappedPiece"], float | None]
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


@dataclass(frozen=True, eq=False)
class MappedPiece:
    """The mapped surface `s_id` at a planned one: `normal` (2,) of the planned one, BIM frame, and its ends along that,
    leftward looking along the normal, metres from the frame's origin."""

    s_id: str
    normal: Floats
    span: tuple[float, float]


def mapped_pieces(
    s_graph: SceneGraph, plan: SceneGraph, T_bim_map: Floats, pairs: Sequence[Sequence[str | float]]
) -> dict[str, list[MappedPiece]]:
    """The mapped surfaces of each planned one; `pairs` as `wall_surfaces` in matches.json, T_bim_map is (4, 4)."""
    pieces: dict[str, list[MappedPiece]] = {}
    for s_id, a_id, *_ in pairs:
        ends = transform_points(T_bim_map, np.array([(*end, 0.0) for end in s_graph.surface_by_id[str(s_id)].ends()]))
        normal = np.array(plan.surface_by_id[str(a_id)].normal)
        along = ends[:, :2] @ [-normal[1], normal[0]]
        piece = MappedPiece(str(s_id), normal, (float(along.min()), float(along.max())))
        pieces.setdefault(str(a_id), []).append(piece)
    return pieces


def deviations_of(
    verdicts: Sequence[ElementVerdict],
    unplanned: Sequence[UnplannedEntry],
    plan: SceneGraph,
    pieces: Mapping[str, Sequence[MappedPiece]],
    offset: Offset,
) -> list[Deviation]:
    """The deviations of wall surfaces. `pieces` are by planned surface; `offset` is that of a wall (by its id) along a
    piece, where the wall as a whole need not be straight, None where it is not known."""
    by_id = {verdict.global_id: verdict for verdict in verdicts}
    planned = [(surface, by_id[wall]) for surface in plan.wall_surfaces for wall in wall_ids(surface) if wall in by_id]
    found = [d for surface, own in planned for d in _of_surface(own, surface, pieces.get(surface.id, []), offset)]
    walls = [(s_id, own) for own in unplanned if own.kind == "wall-like" for s_id in own.surfaces]
    return found + [_deviation("extra", own.reason, s_id=s_id, trace=own.trace) for s_id, own in walls]


def _of_surface(
    verdict: ElementVerdict, surface: WallSurface, pieces: Sequence[MappedPiece], offset: Offset
) -> Iterator[Deviation]:
    """The entries of one surface of a wall with this verdict, one for each mapped piece."""
    of_surface = {"a_id": surface.id, "source": verdict.global_id}
    if verdict.verdict == "absent":
        yield _deviation("absent", verdict.reason, **of_surface)
    elif verdict.offset_m is not None and verdict.direction is not None:
        cosine = float(np.dot(verdict.direction[:2], surface.normal))
        if abs(cosine) < _ACROSS:
            return
        for piece in pieces:
            sigma = verdict.sigma_m or 0.0
            whole = verdict.offset_m * float(np.sign(cosine))
            here = offset(verdict.global_id, piece)
            off = whole if here is None else here
            reason = f"{1000 * off:+.0f} mm here; its wall is {verdict.verdict}: {verdict.reason}"
            more = {"tilt_rad": verdict.turn_rad or 0.0, "sigma_m": sigma, "offset_m": off, "s_id": piece.s_id}
            significant = is_off(verdict.verdict, verdict.offset_m, sigma)
            yield _deviation("moved", reason, **of_surface, **more, significant=significant)


def _deviation(kind: str, reason: str, **known: Any) -> Deviation:
    """An entry with these fields; the others are null."""
    entry = dict.fromkeys(Deviation.__annotations__) | {"source": "", "significant": True, "kind": kind}
    return cast(Deviation, entry | {"reason": reason} | known)
