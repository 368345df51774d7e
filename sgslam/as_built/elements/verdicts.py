"""A verdict for each planned element: as planned, moved, absent, not seen or uncertain, by one likelihood test."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from data.common.bars import steps
from data.plans.bodies import PlannedElement
from sgslam.as_built.elements.columns import column_finding, is_column
from sgslam.as_built.elements.likelihoods import (
    BEFORE,
    DEPTH,
    LEAST_CELLS,
    LEAST_VIEWS,
    SPREAD,
    SURE,
    THROUGH,
    Finding,
    Limits,
    bell,
    judged,
    pose_noise,
    too_little,
    turn_of,
)
from sgslam.as_built.elements.openings import opening_finding
from sgslam.as_built.elements.rays import CELL, SeenRays, Sightings, View
from sgslam.as_built.elements.statuses import main_axis, with_progress
from sgslam.config.sensor import BUILDING, SENSOR

Floats = NDArray[np.float64]
_LEAST_SHARE = 0.3  # of the sightings of a moved surface: if nearly all are before it, so may be what is taken for it


def element_findings(
    elements: Sequence[PlannedElement], rays: SeenRays, seen: Sightings, limits: Limits
) -> list[Finding]:
    """What was found of each element, in their order, by `rays` that were compared with those that are solid, and what
    they have `seen` of these.

    An element is moved or as planned by its likeliest offset (`judged`).
    """
    solids = [element for element in elements if element.kind == "solid"]
    order = np.argsort(seen.element, kind="stable")
    ends = np.searchsorted(seen.element[order], np.arange(len(solids) + 1))
    found: dict[str, Finding] = {}
    for k, element in enumerate(steps(solids, "elements")):
        if is_column(element):
            found[element.global_id] = column_finding(k, solids, rays, limits)
        else:
            found[element.global_id] = _solid(element, seen, order[ends[k] : ends[k + 1]], rays.views, limits)
    index = {element.global_id: k for k, element in enumerate(solids)}
    for opening in steps([element for element in elements if element.kind == "opening"], "doors and windows"):
        host = index.get(opening.wall)
        if host is None:
            found[opening.global_id] = Finding("not seen", "the plan has no wall around it")
            continue
        found[opening.global_id] = opening_finding(opening, solids, host, found[opening.wall], rays, limits)
    return with_progress(elements, [found[element.global_id] for element in elements], rays, seen)


def _solid(
    element: PlannedElement, seen: Sightings, mine: NDArray[np.int64], views: Sequence[View], limits: Limits
) -> Finding:
    """The likelihoods of the sightings of a body, if it stands at its best offset, and if it is absent.

    Rays pass through panes that the plan does not show, all that meet one of them together.
    """
    glazed, direction = element.pane > 0, main_axis(element.triangles)
    mine = mine[np.abs(seen.normal[mine] @ direction) > BUILDING.parallel]
    count = len(np.unique(seen.view[mine]))
    cells = len(np.unique(seen.cell[mine], axis=0))
    if count < LEAST_VIEWS or cells < LEAST_CELLS:
        return Finding("not seen", too_little(cells, count), views=count)
    sign = np.sign(seen.normal[mine] @ direction)
    offset = seen.offset[mine]
    _, cell, counts = np.unique(seen.cell[mine], axis=0, return_inverse=True, return_counts=True)
    weight = 1 / counts[cell.ravel()]
    d = _mode(sign * offset, weight)
    before = offset - sign * d  # what was met, before (+) or behind (-) the surface that stands at d
    at, through = np.abs(before) < 3 * SENSOR.range_noise, before < -SENSOR.apart
    tells = weight * np.where(through, CELL**2 / element.pane, 1.0) if glazed else weight
    stands = float(np.sum(tells * _log_standing(before, BUILDING.glass if glazed else THROUGH)))
    absent = float(np.sum(tells * _log_absent(offset)))
    share = float(np.sum(weight * (at | through)) / np.sum(weight))
    enough = 0.5 * LEAST_CELLS
    if absent - stands > SURE and np.sum(weight * through) >= enough:  # not only behind it by centimetres: an edge
        return Finding("absent", "seen through its place", seen=share, views=count)
    if stands - absent < SURE or np.sum(weight * at) < enough:
        if glazed and np.sum(weight * through) >= np.sum(weight * at):
            return Finding("uncertain", "seen through: it is absent, elsewhere, or of glass", seen=share, views=count)
        return Finding("not seen" if not through.any() else "uncertain", "mostly hidden", seen=share, views=count)
    scatter = SENSOR.range_noise / np.sqrt(max(np.sum(weight * at), 1.0))
    poses = pose_noise([views[k] for k in np.unique(seen.view[mine[at]])], direction)
    sigma = float(np.linalg.norm([scatter, limits.shared, poses.position]))
    places = np.asarray(CELL * (seen.cell[mine[at]] + 0.5), dtype=np.float64)
    turn = turn_of(places, (sign * offset)[at], weight[at], direction, SENSOR.range_noise, poses)
    d = float(np.median((sign * offset)[at]))
    n = (float(direction[0]), float(direction[1]), float(direction[2]))
    sides = np.unique(sign[at])
    is_seen_through = bool(np.sum(weight * through) > np.sum(weight * at))
    doubt = "most of what was seen is in front of it" if share < _LEAST_SHARE else ""
    doubt = "most of it is seen through" if is_seen_through else doubt
    if abs(d) > SENSOR.apart / 2 and sides.size == 1 and sides[0] * d > 0:
        doubt = "in front of it on one side only: it may be furniture"
    verdict, kept = judged(d, sigma, bool(doubt), limits.tolerance)
    if is_seen_through and not glazed:
        verdict, kept = "uncertain", "not conclusive"
    reason = f"its surface is at {1000 * d:+.0f} mm, as measured {int(at.sum()):,} times"
    if doubt and verdict == "uncertain":
        reason = f"{reason}; {doubt}"
    return Finding(verdict, reason, d, n, sigma, turn, kept, share, count, bool(doubt))


def offset_along(seen: Sightings, solid: int, normal: Floats, span: tuple[float, float]) -> float | None:
    """Metres along the upright `normal` (2,), by which most of one stretch of a face is off its plan; None where too
    little of it was seen. `span` are its ends along the face, leftward looking along the normal, from the origin."""
    along = CELL * (seen.cell[:, :2] + 0.5) @ np.array([-normal[1], normal[0]])
    within = (along > span[0]) & (along < span[1])
    own = (seen.element == solid) & (seen.normal[:, :2] @ normal > BUILDING.parallel) & within
    _, cell, counts = np.unique(seen.cell[own], axis=0, return_inverse=True, return_counts=True)
    if len(counts) < LEAST_CELLS:
        return None
    offset = seen.offset[own]
    d = _mode(offset, 1 / counts[cell.ravel()])
    near = np.abs(offset - d) < 3 * SENSOR.range_noise
    return float(np.median(offset[near])) if near.any() else None


def _mode(shift: Floats, weight: Floats) -> float:
    """The shift that most cells agree on."""
    candidates = np.arange(-BUILDING.displaced, BUILDING.displaced + 1e-9, SENSOR.range_noise / 2)
    near = np.exp(-0.5 * ((shift[None] - candidates[:, None]) / SENSOR.range_noise) ** 2)
    return float(candidates[np.argmax(near @ weight)])


def _log_standing(before: Floats, gaps: float) -> Floats:
    """Log-densities (1/m) of what is met, if a surface with a share of `gaps` stands: it, and things on both sides."""
    else_ = np.where(before > 0, BEFORE, gaps) / DEPTH
    return np.asarray(np.log((1 - BEFORE - gaps) * bell(before) + else_))


def _log_absent(offset: Floats) -> Floats:
    """Log-densities (1/m), if nothing stands there: mostly what is behind, as much before it as if it stood."""
    elsewhere = np.where(offset > 3 * SENSOR.range_noise, BEFORE, SPREAD)
    return np.asarray(np.log(np.where(offset < -SENSOR.apart, 1 - BEFORE - SPREAD, elsewhere) / DEPTH))
