"""Missing walls: planned ones that the scans see through."""

import numpy as np
from numpy.typing import NDArray

from sgslam.anchoring import WallAlignment
from sgslam.as_built.deviation_entries import AbsentDeviation
from sgslam.as_built.deviation_tests import OPENING, DeviationTest, in_place, longest_opening
from sgslam.as_built.deviations import Piece
from sgslam.as_built.visibility import STEP, Visibility
from sgslam.as_built.wall_solids import Key, Side, WallSolid
from sgslam.config import Config

Floats = NDArray[np.float64]
_LEAST_OPEN = 1.2, 0.6  # m and share of a surface's length that must be seen through
_MIN_IN_PLACE = 0.45  # m in place; a side of which so much stands is there
_STANDING = 0.25  # of the open length; a wall of which more stands in its place is there
_MIN_OPEN = 0.3  # m of a surface of a missing wall that are seen through, for the surface to be listed


def missing_walls(
    sides: list[Side], solids: list[WallSolid], alignment: WallAlignment, pieces: list[Piece],
    results: list[DeviationTest], visibility: dict[Key, Visibility], config: Config,
) -> list[AbsentDeviation]:  # fmt: skip
    """The entries of deviations.json of the sides of missing walls of a storey.

    A side is missing where most of its length was seen through. A whole wall is missing where hardly any of it stands
    in place on either side, none of it was moved, and a stretch of it was seen through: furniture may hide the rest.
    """
    gone = {key for key, s in visibility.items() if s.open >= max(_LEAST_OPEN[0], _LEAST_OPEN[1] * s.length)}
    gone -= {p.key for p in pieces if in_place(p, config) and p.length >= _MIN_IN_PLACE}
    for solid in solids:
        own = [(p, v) for p, v in zip(pieces, results, strict=True) if p.key in solid.facing]
        if any(v.significant for _, v in own):
            gone -= solid.facing.keys()
        elif _is_gone(solid, [p for p, _ in own], alignment, visibility, config):
            gone |= {key for key in solid.facing if key in visibility and visibility[key].open >= _MIN_OPEN}
    return [
        {
            "s_id": None, "a_id": side.surface.id, "source": side.source, "kind": "absent", "offset_m": None,
            "tilt_rad": None, "sigma_m": None, "significant": True,
            "reason": f"seen through over {visibility[side.key].open:.1f} m of {visibility[side.key].length:.1f} m",
        }
        for side in sides if side.key in gone
    ]  # fmt: skip


def _is_gone(
    solid: WallSolid, own: list[Piece], alignment: WallAlignment, visibility: dict[Key, Visibility], config: Config
) -> bool:
    """Whether a wall with no moved piece is missing."""
    if longest_opening(solid, visibility) < OPENING:
        return False
    asked = [key for key in solid.facing if key in visibility]
    open_ = sum(visibility[key].open for key in asked)
    standing = sum(p.length for p in own if in_place(p, config))
    at = sum(_unexplained(visibility[key], [p for p in own if p.key == key]) for key in asked)
    return standing < _STANDING * open_ and at <= open_


def _unexplained(visibility: Visibility, own: list[Piece]) -> float:
    """Metres at which something stands other than the pieces, which are known to be furniture."""
    at = visibility.at.copy()
    for piece in own:
        at &= (visibility.along < piece.span[0]) | (visibility.along > piece.span[1])
    return STEP * float(at.sum())
