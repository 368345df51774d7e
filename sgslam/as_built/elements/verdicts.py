"""A verdict for each planned element: as planned, moved, absent, not seen or uncertain, by one likelihood test."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from data.scene_graph import SceneGraph
from sgslam.as_built.elements.entries import ElementVerdict, Finding, Verdict, entry
from sgslam.as_built.elements.sightings import CELL, Sightings, View, sightings
from sgslam.as_built.elements.tolerance_classes import SURE_SIGMAS
from sgslam.as_built.elements.turns import PoseNoise, turn_of

if TYPE_CHECKING:
    from data.plans.elements import PlannedElement  # loads ifcopenshell

Floats = NDArray[np.float64]
_LEAST_VIEWS, _LEAST_CELLS = 3, 6  # keyframes, and cells of 0.25 m, that say anything of an element
_NOISE = 0.02  # m, standard deviation of one sighting of a cell: noise of a range, and texture of a surface
_REACH = 0.4  # m, largest offset that is looked for; beyond it stands another thing
_BEHIND = 0.15  # m behind a surface, from which on a ray went through it
_BEFORE, _THROUGH, _SPREAD = 0.2, 0.03, 0.05  # of the sightings of a surface: things before it, gaps in it, outliers
_SURE = np.log(100.0)  # log-likelihood of a cell's evidence by which one hypothesis must lead


def element_verdicts(
    elements: list["PlannedElement"], views: Sequence[View], plan: SceneGraph, tolerance: float, shared: float
) -> list[ElementVerdict]:
    """A verdict for each element, in their order.

    `tolerance` (m) is the largest offset that counts as planned, `shared` (m) the standard deviation of the error that
    all sightings of an element share. An element is moved or as planned by its likeliest offset, and `conclusive` where
    two sigma do not reach the tolerance; where one sigma is larger than the tolerance, the measurement does not tell.
    """
    found: dict[str, Finding] = {}
    for kind in ("solid", "opening"):
        own = [element for element in elements if element.kind == kind]
        if not own:
            continue
        seen = sightings(own, views)
        order = np.argsort(seen.element, kind="stable")
        ends = np.searchsorted(seen.element[order], np.arange(len(own) + 1))
        for k, element in enumerate(own):
            mine = order[ends[k] : ends[k + 1]]
            solid = kind == "solid"
            found[element.global_id] = _solid(seen, mine, views, tolerance, shared) if solid else _opening(seen, mine)
    return [entry(element, found[element.global_id], plan) for element in elements]


def _solid(
    seen: Sightings, mine: NDArray[np.int64], views: Sequence[View], tolerance: float, shared: float
) -> Finding:  # fmt: skip
    """The likelihoods of the sightings of a body, if it stands at its best offset, and if it is absent."""
    count = len(np.unique(seen.view[mine]))
    cells = len(np.unique(seen.cell[mine], axis=0))
    if count < _LEAST_VIEWS or cells < _LEAST_CELLS:
        return Finding("not seen", f"{cells} cells from {count} keyframes", views=count)
    mine, direction = _main_axis(seen, mine)
    sign = np.sign(seen.normal[mine] @ direction)
    offset = seen.offset[mine]
    _, cell, counts = np.unique(seen.cell[mine], axis=0, return_inverse=True, return_counts=True)
    weight = 1 / counts[cell.ravel()]
    d = _mode(sign * offset, weight)
    before = offset - sign * d  # what was met, before (+) or behind (-) the surface that stands at d
    stands = float(np.sum(weight * _log_standing(before)))
    absent = float(np.sum(weight * _log_absent(offset)))
    at, through = np.abs(before) < 3 * _NOISE, before < -_BEHIND
    share = float(np.sum(weight * (at | through)) / np.sum(weight))
    enough = 0.5 * _LEAST_CELLS
    if absent - stands > _SURE and np.sum(weight * through) >= enough:  # not only behind it by centimetres: an edge
        return Finding("absent", "seen through its place", conclusive=True, seen=share, views=count)
    if stands - absent < _SURE or np.sum(weight * at) < enough:
        return Finding("not seen" if not through.any() else "uncertain", "mostly hidden", seen=share, views=count)
    scatter = _NOISE / np.sqrt(max(np.sum(weight * at), 1.0))
    poses = _pose_noise([views[k] for k in np.unique(seen.view[mine[at]])])
    sigma = float(np.linalg.norm([scatter, shared, poses.position]))
    places = np.asarray(CELL * (seen.cell[mine[at]] + 0.5), dtype=np.float64)
    turn = turn_of(places, (sign * offset)[at], weight[at], direction, _NOISE, poses)
    d = float(np.median((sign * offset)[at]))
    n = (float(direction[0]), float(direction[1]), float(direction[2]))
    margin = abs(abs(d) - tolerance)
    sure = margin > SURE_SIGMAS * sigma
    verdict: Verdict = "as planned" if abs(d) <= tolerance else "moved"
    reason = f"its surface is at {1000 * d:+.0f} mm, by {int(at.sum())} sightings"
    if not sure and sigma > tolerance:
        verdict, reason = "uncertain", f"{reason}; a sigma of {1000 * sigma:.0f} mm is too large for the tolerance"
    if verdict == "moved" and abs(d) > _BEHIND / 2 and _could_be_furniture(sign[at], d):
        verdict, reason, sure = "uncertain", f"{reason}; on one side only and before it: it may be furniture", False
    return Finding(verdict, reason, d, n, sigma, turn, sure, share, count)


def _pose_noise(views: list[View]) -> PoseNoise:
    position, heading = np.median([(view.sigma, view.sigma_heading) for view in views], axis=0).tolist()
    return PoseNoise(position, heading, len(views))


def _opening(seen: Sightings, mine: NDArray[np.int64]) -> Finding:
    """An opening is there where rays pass; a closed leaf, a pane and a wall that fills it look alike.

    A ray that ends before it says nothing of it: other walls hide it.
    """
    mine = mine[seen.offset[mine] < _BEHIND]
    count = len(np.unique(seen.view[mine]))
    cells = len(np.unique(seen.cell[mine], axis=0))
    if count < _LEAST_VIEWS or cells < _LEAST_CELLS:
        return Finding("not seen", f"{cells} cells from {count} keyframes", views=count)
    open_ = seen.offset[mine] < -_BEHIND
    if open_.mean() > 0.5:
        return Finding("as planned", "rays pass through its opening", conclusive=True, seen=1.0, views=count)
    return Finding("uncertain", "something closes its opening: a leaf, a pane or a wall", seen=1.0, views=count)


def _main_axis(seen: Sightings, mine: NDArray[np.int64]) -> tuple[NDArray[np.int64], Floats]:
    """The sightings of the faces along the axis with most of them, and that axis."""
    normal = seen.normal[mine]
    axis = normal * np.where(np.abs(normal[:, :1]) > 0.1, np.sign(normal[:, :1]), 1.0)
    axis *= np.where(np.abs(normal[:, :1]) > 0.1, 1.0, np.where(normal[:, 1:2] < -0.1, -1.0, 1.0))
    level = np.abs(normal[:, 2]) > 0.7
    axis[level] = [0.0, 0.0, 1.0]
    _, first, group = np.unique(np.rint(20 * axis), axis=0, return_index=True, return_inverse=True)
    best = int(np.argmax(np.bincount(group.ravel())))
    return mine[group.ravel() == best], axis[first[best]]


def _mode(shift: Floats, weight: Floats) -> float:
    """The shift that most cells agree on."""
    candidates = np.arange(-_REACH, _REACH + 1e-9, _NOISE / 2)
    near = np.exp(-0.5 * ((shift[None] - candidates[:, None]) / _NOISE) ** 2)
    return float(candidates[np.argmax(near @ weight)])


def _log_standing(before: Floats) -> Floats:
    """Log-densities (1/m) of what is met, if an opaque surface stands: it, things before it, rarely what is behind."""
    at = np.exp(-0.5 * (before / _NOISE) ** 2) / (_NOISE * np.sqrt(2 * np.pi))
    else_ = np.where(before > 0, _BEFORE, _THROUGH) / 5.0
    return np.asarray(np.log((1 - _BEFORE - _THROUGH) * at + else_))


def _log_absent(offset: Floats) -> Floats:
    """Log-densities (1/m), if nothing stands there: mostly what is behind."""
    return np.asarray(np.log(np.where(offset < -_BEHIND, 1 - _BEFORE - _SPREAD, _BEFORE + _SPREAD) / 5.0))


def _could_be_furniture(sign: Floats, d: float) -> bool:
    return len(np.unique(sign)) == 1 and float(sign[0]) * d > 0

