"""Deviation tests: which walls stand elsewhere than planned, by all that was seen of both their sides."""

from dataclasses import dataclass

import numpy as np

from sgslam.as_built.deviation_entries import MovedDeviation
from sgslam.as_built.deviations import Piece
from sgslam.as_built.visibility import Visibility
from sgslam.as_built.wall_solids import Key, WallSolid
from sgslam.config import Config

_NICHE = (-0.35, -0.03)  # m, offsets of a window pane behind its wall
_ALIKE = 0.05  # m between the offsets of pieces that count as equal
_MIN_AS_PLANNED = {
    True: 0.5,
    False: 0.35,
}  # of a wall's length that make it stand as planned, against pieces before, behind
_LEAST_SEEN = 0.45  # m of a wall that must be seen elsewhere for it to be significant
_LEAST_LOW = 0.5  # m of a wall seen close to the floor, which then decide alone
_FURNITURE = 0.25  # m before a wall's place, from which on a surface may be the front of furniture
_FAR_SIDE = 0.1  # m to a wall's other side where the plan does not give it
_TOUCHING = 0.02  # m between a wall and furniture that touches it
OPENING = 0.4  # m in one stretch that are seen through


@dataclass(frozen=True)
class DeviationTest:
    """The result for one piece: whether it shows that its wall stands elsewhere than planned, and the reason."""

    significant: bool
    reason: str


def run_deviation_tests(
    pieces: list[Piece], solids: list[WallSolid], visibility: dict[Key, Visibility], config: Config
) -> list[DeviationTest]:
    """The result for each piece, in their order. `visibility` is that of the sides of the walls."""
    solid_of = {key: k for k, solid in enumerate(solids) for key in solid.facing}
    of_solid: dict[int, list[int]] = {}
    for i, piece in enumerate(pieces):
        of_solid.setdefault(solid_of[piece.key], []).append(i)
    found: dict[int, DeviationTest] = {}
    for k, own in of_solid.items():
        results = _tested([pieces[i] for i in own], solids[k], visibility, config)
        found.update(zip(own, results, strict=True))
    return [found[i] for i in range(len(pieces))]


def as_planned(piece: Piece, config: Config) -> bool:
    """Whether a piece's offset is within the user's tolerance or three sigma."""
    return abs(piece.offset) <= max(config.as_built.tolerance, 3 * piece.sigma)


def in_place(piece: Piece, config: Config) -> bool:
    """Whether a piece can only be the planned wall, moved or not: a fine tolerance makes no wall missing."""
    return as_planned(piece, config) or abs(piece.offset) <= config.anchors.tolerance


def moved_walls(pieces: list[Piece], results: list[DeviationTest]) -> list[MovedDeviation]:
    """The entries of deviations.json of the walls at a planned one, moved or not."""
    return [
        {
            "s_id": piece.aligned.surface.id, "a_id": piece.aligned.planned.id, "source": piece.source,
            "kind": "moved", "offset_m": piece.offset, "tilt_rad": piece.tilt, "sigma_m": piece.sigma,
            "significant": result.significant, "reason": result.reason,
        }
        for piece, result in zip(pieces, results, strict=True)
    ]  # fmt: skip


def _tested(
    own: list[Piece], solid: WallSolid, visibility: dict[Key, Visibility], config: Config
) -> list[DeviationTest]:
    """The results for the pieces of one wall."""
    telling = _telling([p for p in own if not p.doubtful])
    off = [p for p in telling if not as_planned(p, config)]
    if not off:
        return [_insignificant(p, config, "only seen over a parapet, behind its wall: a pane") for p in own]
    middle, alike = _largest(off, solid)
    standing = sum(p.length for p in telling if as_planned(p, config))
    length = sum(p.length for p in alike)
    before = float(np.median([p.offset for p in alike])) > 0
    against = None
    if standing >= _MIN_AS_PLANNED[before] * (standing + length):
        what = "furniture in front of it" if before else "a niche or pane behind it"
        against = f"{standing:.1f} m of this wall stand as planned; this is {what}"
    elif length < _LEAST_SEEN:
        against = f"too little: {length:.1f} m of this wall were seen elsewhere"
    elif _may_be_furniture(alike, solid) and longest_opening(solid, visibility) >= OPENING:
        against = "the wall is seen through; this is furniture in its place"
    if against is not None:
        return [_insignificant(p, config, against) for p in own]
    sides = len({solid.facing[p.key] for p in alike})
    reason = f"{length:.1f} m of this wall, on {'both sides' if sides == 2 else 'one side'}, have the same offset"
    return [
        DeviationTest(True, reason)
        if not as_planned(p, config) and abs(_shift(p, solid) - middle) < _ALIKE
        else _insignificant(p, config, "most of this wall has another offset")
        for p in own
    ]


def _insignificant(piece: Piece, config: Config, against: str) -> DeviationTest:
    if as_planned(piece, config):
        near = abs(piece.offset) <= config.as_built.tolerance
        return DeviationTest(False, "as planned" if near else "within three sigma of its place")
    return DeviationTest(False, "short and skewed: poorly observed" if piece.doubtful else against)


def _telling(own: list[Piece]) -> list[Piece]:
    """The pieces that can only be the wall itself: those seen low, else all but window panes in niches."""
    low = [p for p in own if not p.over_parapet]
    if sum(p.length for p in low) >= _LEAST_LOW:
        return low
    return [p for p in own if not (p.over_parapet and _NICHE[0] < p.offset < _NICHE[1])]


def _shift(piece: Piece, solid: WallSolid) -> float:
    """The shift (m) along the solid's normal, which is equal for both sides of a moved wall."""
    return solid.facing[piece.key] * piece.offset


def _largest(off: list[Piece], solid: WallSolid) -> tuple[float, list[Piece]]:
    """The shift (m) that the greatest length of a wall agrees on, and the pieces that agree."""
    shifts = np.array([_shift(p, solid) for p in off])
    lengths = np.array([p.length for p in off])
    near = np.abs(shifts[:, None] - shifts[None]) < _ALIKE
    best = int(np.argmax(near @ lengths))
    return float(shifts[best]), [p for p, is_near in zip(off, near[best].tolist(), strict=True) if is_near]


def _may_be_furniture(alike: list[Piece], solid: WallSolid) -> bool:
    """Whether pieces could be furniture at a wall that was never built.

    Either its front, well before the wall's place, or its back seen from behind, at or beyond the wall's far side.
    """
    far_side = -(solid.thickness or _FAR_SIDE) + _TOUCHING
    if len({solid.facing[p.key] for p in alike}) == 2:
        return all(p.offset < far_side for p in alike)
    return all(p.offset < far_side or p.offset > _FURNITURE for p in alike)


def longest_opening(solid: WallSolid, visibility: dict[Key, Visibility]) -> float:
    """The longest stretch (m) of a wall that is seen through from one side."""
    return max((visibility[key].longest_opening for key in solid.facing if key in visibility), default=0.0)
