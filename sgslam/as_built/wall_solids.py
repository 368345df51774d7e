"""Wall solids: the walls of a plan with both sides of each, one solid for each wall of the plan's source."""

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
    """The side of one wall that faces one room.

    `spans` (m) are where it has full height, along its surface, leftward from the surface's centre when looking along
    the normal; `hull` (m) is its extent with doors and windows.
    """

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
    """One straight wall. `facing` is 1 for sides that face along the solid's normal, -1 for those that face against it.

    `thickness` (m) is between the outermost sides, None where the plan has one side only.
    """

    facing: dict[Key, int]
    thickness: float | None


def sides_of(surface: WallSurface) -> list[Side]:
    """The sides of the walls that a surface is made of; one side for the whole surface where it has no parts."""
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
    """Groups sides into solids: parallel sides of one source, no further apart than a wall is thick.

    A surface without a source is a solid of its own.
    """
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
    """Solids along the common normal, separated where the gap is wider than a wall."""
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
