"""The walls of a plan as solids: both sides of each together, one for each wall that the plan's source knows."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data import WallSurface

Floats = NDArray[np.float64]
Key = tuple[str, str]  # a surface's id, and the source of the wall that it is of there
Spans = tuple[tuple[float, float], ...]
_PARALLEL = 0.999  # cosine
_THICKEST = 0.7  # m between the sides of one wall


@dataclass(frozen=True)
class Side:
    """What one wall turns to one room: `spans` (m) along its surface, leftward from the surface's middle as one looks
    along the normal, where it stands in full height; `hull`: from where to where, doors and windows included."""

    surface: WallSurface
    source: str
    spans: Spans
    hull: tuple[float, float]

    @property
    def key(self) -> Key:
        """The surface's id and the wall's source."""
        return self.surface.id, self.source


@dataclass(frozen=True)
class WallSolid:
    """One straight wall. `facing` tells of each side whether it faces along the solid's normal (1) or against it (-1);
    `thickness` (m) lies between the outermost of both, None where the plan has one side only."""

    facing: dict[Key, int]
    thickness: float | None


def sides_of(surface: WallSurface) -> list[Side]:
    """The walls that a surface is made of; the surface itself where it does not tell."""
    if not surface.parts:
        half = 0.5 * (surface.length or 0.0)
        return [Side(surface, surface.source, ((-half, half),), (-half, half))]
    sides = []
    for source in dict.fromkeys(part[0] for part in surface.parts):
        own = [part for part in surface.parts if part[0] == source]
        spans = tuple(sorted((low, high) for _, low, high, whole in own if whole))
        sides.append(Side(surface, source, spans, (min(p[1] for p in own), max(p[2] for p in own))))
    return sides


def solids_of(sides: Iterable[Side]) -> list[WallSolid]:
    """Sides of one source are of one solid where they are parallel and no further apart than a wall is thick; those of
    a surface without a source are solids of their own."""
    by_source: dict[str, list[Side]] = {}
    for side in sides:
        by_source.setdefault(side.source or f"\0{side.surface.id}", []).append(side)
    return [solid for own in by_source.values() for parallel in _parallel(own) for solid in _stacked(parallel)]


def _parallel(sides: list[Side]) -> list[list[Side]]:
    groups: list[list[Side]] = []
    for side in sides:
        n = np.array(side.surface.normal)
        own = next((g for g in groups if abs(n @ g[0].surface.normal) > _PARALLEL), None)
        if own is None:
            groups.append([side])
        else:
            own.append(side)
    return groups


def _stacked(parallel: list[Side]) -> list[WallSolid]:
    """Bodies along the common normal, parted where the gap is wider than a wall."""
    first = parallel[0].surface
    n = np.array(first.normal)
    across = np.array([np.subtract(side.surface.centroid, first.centroid) @ n for side in parallel])
    order = np.argsort(across, kind="stable")
    parted = np.split(order, np.flatnonzero(np.diff(across[order]) > _THICKEST) + 1)
    return [_solid([parallel[k] for k in part.tolist()], across[part], n) for part in parted]


def _solid(sides: list[Side], across: Floats, n: Floats) -> WallSolid:
    facing = np.array([1 if n @ side.surface.normal > 0 else -1 for side in sides])
    thickness = 0.0
    if len(set(facing.tolist())) == 2:
        thickness = float(across[facing > 0].max() - across[facing < 0].min())
    return WallSolid(
        {s.key: f for s, f in zip(sides, facing.tolist(), strict=True)}, thickness if thickness > 0 else None
    )
