"""Vertical wall planes with their extent, from one levelled scan."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sgslam.config import SurfaceSettings
from sgslam.virtual_scan import ColumnScan, Floats, contour, split_chains

_NOISE = 0.02  # m, of a range; the fit's own residual is used where it is larger
_INLIER = 0.06  # m from the plane


@dataclass(frozen=True)
class WallObservation:
    """One wall piece seen in one scan, in the levelled frame (x y from the sensor, z above the floor).

    `plane` is (nx, ny, nz, d) with n.x + d = 0 and n towards the sensor; `ends` (2, 2) its footprint;
    `heights` the lowest and highest inlier; the sigmas are the fit's, of the normal (the worse of its two
    angles) and of the offset at the foot of the perpendicular.
    """

    plane: Floats
    ends: Floats
    heights: tuple[float, float]
    sigma_normal: float
    sigma_offset: float


def extract_walls(scan: ColumnScan, settings: SurfaceSettings) -> list[WallObservation]:
    """Wall pieces in a scan with z above the floor: split and merge on the high band, a fit on all heights.

    Where the low band stands 6 to 30 cm before the high one, the high one is a window in its niche and is
    dropped.
    """
    column, line = contour(scan, settings.high_band)
    if len(line) < settings.min_columns:
        return []
    line, column = _from_farthest(line, column, scan.columns)
    parapet = np.full((scan.columns, 2), np.nan)
    low_column, low_line = contour(scan, settings.low_band)
    parapet[low_column] = low_line
    start = np.searchsorted(scan.column, np.arange(scan.columns + 1))
    found = []
    for first, last in _merge(split_chains(line, column, 2 * np.pi / scan.columns, settings.split), line, settings):
        if last - first + 1 < settings.min_columns or np.hypot(*(line[last] - line[first])) < settings.min_length:
            continue
        if _is_window(line[first : last + 1], parapet[column[first : last + 1] % scan.columns]):
            continue
        # the outermost columns end the piece, but their points may be of the walls beside it
        own = _between(scan, start, int(column[first]) + 1, int(column[last]) - 1)
        own = own[(own[:, 2] > settings.low_band[0]) & (own[:, 2] < settings.high_band[1])]
        observation = fit_wall(own, line[first], line[last], settings)
        if observation is not None:
            found.append(observation)
    return found


def fit_wall(points: Floats, first: Floats, last: Floats, settings: SurfaceSettings) -> WallObservation | None:
    """Fits a plane near the vertical one through `first` and `last` (2,) to the (N, 3) points close to it.

    Linear least squares of the distance across over the places along and up, twice; None where it fails.
    """
    tangent = (last - first) / np.hypot(*(last - first))
    normal = np.array([-tangent[1], tangent[0]])
    if normal @ first > 0:  # towards the sensor, which is the origin
        normal = -normal
    middle = (first + last) / 2
    length = float(np.hypot(*(last - first)))
    points = points[np.abs((points[:, :2] - middle) @ tangent) < length / 2 + 0.1]
    along, across = ((points[:, :2] - middle) @ tangent), ((points[:, :2] - middle) @ normal)
    up = points[:, 2]
    solution = np.zeros(3)
    for tolerance in (_INLIER, 0.75 * _INLIER):
        height = float(up.mean()) if len(up) else 0.0
        residual = across - solution[0] - solution[1] * along - solution[2] * (up - height)
        inlier = np.abs(residual) < tolerance
        if inlier.sum() < 2 * settings.min_columns:
            return None
        height = float(up[inlier].mean())
        design = np.column_stack([np.ones(inlier.sum()), along[inlier], up[inlier] - height])
        # the tilt is 0 within a degree as far as the points do not say otherwise
        information = design.T @ design / _NOISE**2 + np.diag([0.0, 0.0, 1 / 0.017**2])
        solution = np.linalg.solve(information, design.T @ across[inlier] / _NOISE**2)
    if abs(solution[2]) > settings.max_tilt or len(up) > 5 * inlier.sum():
        return None
    noise = max(float(np.std(across[inlier] - design @ solution)), _NOISE / 2) / _NOISE
    covariance = np.linalg.inv(information) * noise**2
    plane_normal = np.array([*(normal - solution[1] * tangent), -solution[2]])
    scale = np.linalg.norm(plane_normal)
    centre = np.array([*(middle + solution[0] * normal), height])
    spread = (-length / 2, length / 2)
    ends = np.array([middle + s * tangent + (solution[0] + solution[1] * s) * normal for s in spread])
    foot = float(np.dot(centre[:2], tangent))
    return WallObservation(
        plane=np.array([*(plane_normal / scale), -plane_normal @ centre / scale]),
        ends=ends,
        heights=(float(up[inlier].min()), float(up[inlier].max())),
        sigma_normal=float(np.sqrt(max(covariance[1, 1], covariance[2, 2]))),
        sigma_offset=float(np.sqrt(covariance[0, 0] + foot**2 * covariance[1, 1])),
    )


def _from_farthest(contour: Floats, column: NDArray[np.int64], columns: int) -> tuple[Floats, NDArray[np.int64]]:
    """Turns the closed contour so that it begins at its farthest point, which is always the end of a straight
    piece, so that the scan's seam cuts no wall; columns go on rising."""
    first = int(np.argmax(np.hypot(contour[:, 0], contour[:, 1])))
    turned = np.concatenate([column[first:], column[:first] + columns])
    return np.roll(contour, -first, axis=0), turned


def _merge(pieces: list[tuple[int, int]], contour: Floats, settings: SurfaceSettings) -> list[tuple[int, int]]:
    """Joins neighbouring pieces that lie on one line with a gap of at most `merge_gap`."""
    merged: list[tuple[int, int]] = []
    for piece in pieces:
        while merged and _collinear(merged[-1], piece, contour, settings):
            piece = (merged.pop()[0], piece[1])
        merged.append(piece)
    return merged


def _collinear(a: tuple[int, int], b: tuple[int, int], contour: Floats, settings: SurfaceSettings) -> bool:
    if np.hypot(*(contour[b[0]] - contour[a[1]])) > settings.merge_gap:
        return False
    chord = contour[b[1]] - contour[a[0]]
    normal = np.array([-chord[1], chord[0]]) / (np.hypot(*chord) + 1e-9)
    points = contour[[a[1], b[0], (a[0] + a[1]) // 2, (b[0] + b[1]) // 2]] - contour[a[0]]
    return bool(np.all(np.abs(points @ normal) < settings.split))


def _between(scan: ColumnScan, start: NDArray[np.int64], first: int, last: int) -> Floats:
    """The upright points of the columns first to last, which may go on beyond the last column of the scan."""
    if last >= scan.columns and first < scan.columns:
        parts = [slice(start[first], None), slice(0, start[last - scan.columns + 1])]
    else:
        parts = [slice(start[first % scan.columns], start[last % scan.columns + 1])]
    return np.concatenate([scan.points[part][scan.upright[part]] for part in parts])


def _is_window(line: Floats, low: Floats) -> bool:
    """Whether the low band stands 6 to 30 cm before a piece, in parallel to it, rather than on it.

    What stands further before it is furniture, which hides the parapet and says nothing.
    """
    chord = line[-1] - line[0]
    normal = np.array([-chord[1], chord[0]]) / np.hypot(*chord)
    if normal @ line[0] > 0:
        normal = -normal
    before = (low - line) @ normal
    seen = before[np.isfinite(before)]
    niche = seen[(seen > 0.06) & (seen < 0.30)]
    on_it = np.count_nonzero(np.abs(seen) <= 0.06)
    return bool(len(niche) >= 3 and len(niche) > 2 * on_it and np.std(niche) < 0.04)
