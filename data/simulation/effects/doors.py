"""Door leaves: shut, ajar, or wide open where the way leads through."""

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from data.simulation.effects.boxes import UprightBox

Array = NDArray[np.float64]
THICK, FRAME = 0.04, 0.05  # m: a leaf's thickness; the frame's width on each side and above
PASSED = 0.6  # m: a way that comes so near to a door's middle leads through
ONE_LEAF = 1.4  # m: a wider door has two leaves
BESIDE = 0.2  # m that a leaf keeps from the way
AJAR_DEG = (20.0, 75.0)


def door_leaves(doors: Sequence[Array], way: Array, rng: np.random.Generator) -> list[UprightBox]:
    """The leaves of doors, triangles (M, 3, 3) each, beside a way (N, 2); one that would be in the way is left out."""
    tree = cKDTree(way)
    leaves: list[UprightBox] = []
    for door in doors:
        outline = _outline(door)
        if outline is None:
            continue
        middle, along, across = outline
        passed = tree.query(middle)[0] < PASSED
        angle = np.radians(90.0 if passed else rng.choice([0.0, rng.uniform(*AJAR_DEG)]))
        low, high = float(door[:, :, 2].min()), float(door[:, :, 2].max()) - FRAME
        for hinge, width in _hinges(middle, along, bool(rng.integers(2))):
            tries = [UprightBox(*_swung(hinge, width, across * side, angle), low, high) for side in (1.0, -1.0)]
            if not passed:
                tries.append(UprightBox(*_swung(hinge, width, across, 0.0), low, high))
            free = [leaf for leaf in tries if tree.query(leaf.footprint)[0].min() > BESIDE]
            leaves += free[:1]
    return leaves


def _outline(door: Array) -> tuple[Array, Array, Array] | None:
    """Middle (2,), half the width along the wall (2,), unit vector across; None where the leaf is drawn swung open."""
    around = shapely.oriented_envelope(shapely.multipoints(door.reshape(-1, 3)[:, :2]))
    if around.geom_type != "Polygon":
        return None
    corners = np.asarray(around.exterior.coords)
    sides = sorted(np.diff(corners[:3], axis=0), key=lambda side: -float(np.linalg.norm(side)))
    width, depth = (float(np.linalg.norm(side)) for side in sides)
    if depth > 0.6 * width or width < 0.5:
        return None
    return corners[:4].mean(axis=0), sides[0] / 2, sides[1] / depth


def _hinges(middle: Array, along: Array, other: bool) -> list[tuple[Array, Array]]:
    """Each leaf's hinge (2,) and, from there, its width (2,) when shut."""
    half = along * (1 - FRAME / float(np.linalg.norm(along)))
    if 2 * np.linalg.norm(along) > ONE_LEAF:
        return [(middle - half, half), (middle + half, -half)]
    return [(middle + half, -2 * half)] if other else [(middle - half, 2 * half)]


def _swung(hinge: Array, width: Array, across: Array, angle: float) -> tuple[Array, Array]:
    """Centre (2,) and half sides (2, 2) of a leaf turned to one side."""
    length = float(np.linalg.norm(width))
    leaf = np.cos(angle) * width + np.sin(angle) * length * across
    normal = np.array([-leaf[1], leaf[0]]) / length
    return hinge + leaf / 2, np.stack([leaf / 2, normal * THICK / 2])
